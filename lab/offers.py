"""What the laboratory adds to Trepid; lab/pyproject.toml names it as entry points."""

from trepid.packages import Verb

BENCH = Verb(
    "lab.bench.cli",
    "bench",
    "Measure time and accuracy of the parts, relative to a peer in the same run.",
    example="trepid bench control --save lab/results",
)
