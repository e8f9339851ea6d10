// A backend in C++ that lets an exception out, which the ABI forbids.
#include "hemicube_backend.h"

extern "C" HcStatus throws(HcSession *, HcRows *, HcError *) { throw 1; }
