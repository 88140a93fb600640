"""Keep a recording and a car folder of this version: ``python tests/kept/keep.py``, before a release.

The car folder states every field of every file, so that a later version meets each name of this one.
"""

import shutil
from pathlib import Path

from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import load_scenario
from trepid import __version__
from trepid.config import CONFIG_DIR

PLACE = Path(__file__).parent / __version__


def keep() -> None:
    """Write the folder of this version anew."""
    shutil.rmtree(PLACE, ignore_errors=True)
    (PLACE / "car").mkdir(parents=True)
    for path in CONFIG_DIR.glob("*.yaml"):
        shutil.copyfile(path, PLACE / "car" / path.name)
    scenario = load_scenario("five_hz", {"duration_s": "4"})  # few images
    with recording(PLACE / "drive.mcap", scenario, raw_images=False) as witness:
        run(scenario, seed=0, witness=witness)


if __name__ == "__main__":
    keep()
