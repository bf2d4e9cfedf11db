"""Becomes another program that ends when its parent does.

Called as `parent_watch.py PARENT_PID PROGRAM ARG …`.

Services watch their parent by themselves, but only once they run: one that is still importing when
its supervisor is killed would take init for its parent and live for ever. On Linux the kernel
watches from the first instruction on; elsewhere this only becomes the program.
"""

import os
import signal
import sys

PR_SET_PDEATHSIG = 1


def main(parent_pid: int, argv: list[str]) -> None:
    """Does not return."""
    if sys.platform == "linux":
        import ctypes

        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
        if os.getppid() != parent_pid:  # it ended before the kernel was told
            sys.exit("the supervisor is gone")
    os.execv(argv[0], argv)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2:])
