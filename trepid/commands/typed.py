"""The command that runs, for records of what it writes."""

import shlex
import sys


def typed_command() -> str:
    """The words after ``trepid``, quoted for a shell where they need it."""
    return shlex.join(["trepid", *sys.argv[1:]])
