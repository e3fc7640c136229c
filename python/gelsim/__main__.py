"""The command `gelsim`."""

import signal
import sys

from gelsim._native import main as run


def main() -> int:
    """Runs the command of `sys.argv`; its exit status."""
    # Python's own handler would wait for Python code to run again, and end it with a traceback.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    return run(["gelsim", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
