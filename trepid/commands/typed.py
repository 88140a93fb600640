"""The command that runs, for records of what it writes."""

import shlex
import sys


def typed_command() -> str:
    """``trepid`` and the words after it, quoted for a shell where they need it."""
    return shlex.join(["trepid", *sys.argv[1:]])
