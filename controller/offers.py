"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers

OFFERS = Offers()
