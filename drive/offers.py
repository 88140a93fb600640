"""What the package offers to command line, Python and launcher."""

from trepid.packages import Offers, Verb

OFFERS = Offers(
    verbs={
        "drive": Verb(
            "drive.cli",
            "drive",
            "Drive with all processes (camera, perception, supervisor, controller, vehicle) over Zenoh.",
        ),
    },
    examples={
        "drive": "trepid drive --scenario cut_in --duration 60 --record drive.mcap",
    },
    functions={
        "drive": "drive.api",
    },
)
