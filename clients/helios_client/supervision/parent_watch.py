"""Become another program that ends when its parent ends.

Called as `parent_watch.py PARENT_PID PROGRAM ARG …`.

Services watch their parent themselves, but only once they run. If the supervisor is killed while a
service is still importing, the service would take init for its parent and run forever. On Linux the
kernel watches from the first instruction on; elsewhere this script only becomes the program.
"""

import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def main(parent_pid: int, argv: list[str]) -> None:
    """Replace this process by the program; does not return."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent_pid:  # the parent ended before the call
            sys.exit("the supervisor is gone")
    os.execv(argv[0], argv)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
