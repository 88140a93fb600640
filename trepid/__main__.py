"""``python -m trepid`` and the console script ``trepid``."""

import sys

if __name__ == "__main__":
    # The folder in which the command is given comes last: one of its folders, such as `controller/`, may have the
    # name of a package.
    sys.path.append(sys.path.pop(0))

from trepid.cli import main

if __name__ == "__main__":
    sys.exit(main())
