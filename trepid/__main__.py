"""``python -m trepid`` and the console script ``trepid``."""

import sys

from trepid.cli import main

if __name__ == "__main__":
    sys.exit(main())
