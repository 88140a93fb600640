"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "bench": Verb(
            "lab.bench.cli",
            "bench",
            "Measure time and accuracy of the parts, relative to a peer in the same run.",
        ),
    },
    examples={
        "bench": "trepid bench control --save lab/results",
    },
    simulates=True,
)
