"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "detector": Verb("perception.lead.detector_cli", "app", "Detectors of vehicles on real roads."),
    },
    examples={
        "detector list": "trepid detector list",
        "detector fetch": "trepid detector fetch objectron",
    },
)
