"""The command `python -m gelsim.ros`."""

import sys

from gelsim.ros.command import main

if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
