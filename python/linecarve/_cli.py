"""The program `linecarve`."""

import signal
import sys

from ._linecarve import main as run


def main():
    """Runs the program with the arguments of this process; ends it with the program's exit status."""
    # Python would wait for the end of the command; the program ends at a keyframe where it can.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(run(["linecarve", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
