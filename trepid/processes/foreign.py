"""Become a command of another package, which ends when the launcher ends.

``python -m trepid.processes.foreign COMMAND ARGUMENT…`` asks the kernel for SIGKILL at the end of its parent, which
holds across exec, and then is replaced by the command.
"""

import ctypes
import os
import signal
import sys

PR_SET_PDEATHSIG = 1  # linux/prctl.h


def main(command: list[str]) -> None:
    """Replace this process by ``command``; ends with one line on standard error when that fails."""
    launcher = os.getppid()
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != launcher:
        sys.exit("the launcher has ended")
    try:
        os.execvp(command[0], command)
    except OSError as error:
        sys.exit(f"{command[0]}: cannot be started: {error.strerror}")


if __name__ == "__main__":
    main(sys.argv[1:])
