"""The program: `python -m hemicube`, and the command `hemicube` that the package installs."""

import signal
import sys

from hemicube import _native


def main() -> int:
    """Runs the program by the command line of this process, and returns its exit code."""
    # Python's own handler waits for Python to go on, which it does when the program has ended.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return _native._main(sys.argv[1:], [sys.executable, __file__])


if __name__ == "__main__":
    sys.exit(main())
