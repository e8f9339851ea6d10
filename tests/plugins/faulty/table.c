/* A good backend behind a bad table: one thing is wrong, by a macro. */
#define hemicube_backend good_backend
#include "../c_minimal/backend.c"
#undef hemicube_backend

#ifndef FAULT_ABI
#define FAULT_ABI HC_ABI_VERSION
#endif
#ifndef FAULT_SIZE
#define FAULT_SIZE sizeof(HcBackend)
#endif
#ifndef FAULT_NAME
#define FAULT_NAME "bad-table"
#endif
#ifndef FAULT_VERSION
#define FAULT_VERSION "1"
#endif
#ifndef FAULT_DEVICES
#define FAULT_DEVICES devices
#endif
#ifndef FAULT_OPEN
#define FAULT_OPEN open
#endif
#ifndef FAULT_LOAD
#define FAULT_LOAD load
#endif
#ifndef FAULT_ROWS
#define FAULT_ROWS rows
#endif
#ifndef FAULT_ITEMS
#define FAULT_ITEMS items
#endif
#ifndef FAULT_CLOSE
#define FAULT_CLOSE close
#endif

#ifndef FAULT_PASS
#define FAULT_PASS NULL
#endif

#ifdef NO_DEVICE
static HcStatus no_device(HcDevice *out, uint32_t capacity, uint32_t *count, HcError *error) {
    (void)out, (void)capacity, (void)error;
    *count = 0;
    return HC_OK;
}
#endif

#ifdef NO_DRIVER
static HcStatus no_driver(HcDevice *out, uint32_t capacity, uint32_t *count, HcError *error) {
    (void)out, (void)capacity, (void)count;
    strcpy(error->message, "no driver is installed");
    return HC_ERROR_UNSUPPORTED;
}
#endif

#ifdef OLD
/* What is behind the end of an old table is not the host's to read. */
static HcStatus behind(HcSession *session, const HcPass *pass, uint32_t *items, HcError *error) {
    (void)session, (void)pass, (void)items, (void)error;
    abort();
}
#endif

#ifdef THROWS
HcStatus throws(HcSession *session, HcRows *rows, HcError *error); /* in throws.cpp */
#endif

#ifdef A_GPU
static HcStatus a_gpu(HcDevice *out, uint32_t capacity, uint32_t *count, HcError *error) {
    HcStatus status = devices(out, capacity, count, error);
    out->kind = HC_DEVICE_DISCRETE_GPU;
    out->capabilities |= HC_CAN_COVERED;
    return status;
}
#endif

#ifndef NO_SYMBOL
extern HC_EXPORT const HcBackend hemicube_backend;
HC_EXPORT const HcBackend hemicube_backend = {
    FAULT_ABI, FAULT_SIZE, FAULT_NAME, FAULT_VERSION, FAULT_DEVICES, FAULT_OPEN, NULL, FAULT_LOAD, FAULT_ROWS, FAULT_ITEMS, FAULT_CLOSE, FAULT_PASS, NULL,
};
#endif
