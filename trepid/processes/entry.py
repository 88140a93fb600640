"""A process of another package: an entry point of the group ``trepid.processes``.

The entry point is a function that takes the :class:`~trepid.processes.process.Process` and returns when
``running()`` is False.
"""

import sys

from trepid.plugins import Group, part
from trepid.processes.process import process

if __name__ == "__main__":
    with process() as me:
        part(Group.PROCESSES, sys.argv[2], {})(me)
