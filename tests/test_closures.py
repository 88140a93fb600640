"""What the processes of a real car load: their own package and the vocabulary, nothing of the proving ground.

Each entry of the table is imported in a process of its own, and builds what it builds for a car: ``sys.modules``
then holds what runs in the car. A module counts where it holds code; to look for a program, the launcher imports
the empty packages above it.
"""

from pathlib import Path
from typing import NamedTuple

import pytest
from closure_rig import lines_of_code, loaded_modules

from cockpit.car.init import Like, write_car
from trepid.config import CAR
from trepid.packages import PACKAGES


class Closure(NamedTuple):
    """An entry of a car: what it runs, what it may load beside ``trepid``, and how much."""

    statements: str
    packages: set[str]  # or rooms
    modules: int  # at most
    lines: int  # of code, at most


CLOSURES = {
    "launcher": Closure(
        "import drive.cli\n"
        "from drive.open_road import course_for\n"
        "from drive.launcher import plan_of\n"
        "road = course_for(None, {}, (), duration_s=None)\n"
        "assert plan_of(road, recorded=True, page=True, foxglove=False).specs",
        {"drive", "vehicle"},  # keys, and the words of the stop button
        52,
        5_380,
    ),
    "camera": Closure(
        "import vehicle.cameras.node, vehicle.cameras.device",
        {"vehicle"},
        28,
        2_500,
    ),
    "cv": Closure(
        "import perception.node\nfrom perception.estimators import build\nassert build('cv')",
        {"perception"},
        47,
        4_790,
    ),
    "cv, which judges the image": Closure(
        "import perception.node\n"
        "from perception.estimators import build\n"
        "from perception.sight.judge import build as build_judge\n"
        "assert build('cv') and build_judge()",
        {"perception"},
        59,
        6_130,
    ),
    "cnn": Closure(
        "import perception.node\nfrom perception.estimators import build\nassert build('cnn')",
        {"perception"},
        40,
        4_190,
    ),
    "segments": Closure(
        "import perception.node, perception.segments.estimator",
        {"perception"},
        55,
        5_251,
    ),
    "lead": Closure(
        "import perception.lead.node\nfrom perception.lead.finder import build\nassert build()",
        {"perception"},
        53,
        5_540,
    ),
    "supervisor": Closure(
        "import supervisor.node\n"
        "from supervisor.supervisor import build\n"
        "from trepid.config import default_file\n"
        "assert build(rules=default_file('fear.yaml'))",
        {"supervisor"},
        60,
        6_985,
    ),
    "controller": Closure(
        "import controller.node\nfrom controller.controller import build\nassert build()",
        {"controller"},
        41,
        3_870,
    ),
    "vehicle": Closure(
        "import vehicle.actuators.node, vehicle.actuators.can.actuator\n"
        "from controller.limiter import build\n"
        "assert build()",
        {"vehicle", "controller"},  # the limiter
        47,
        4_840,
    ),
    "recorder": Closure("import trepid.recording.node", set(), 29, 3_420),
    "driver input": Closure(
        "import vehicle.driver.node",
        {"vehicle"},
        22,
        2_250,
    ),
    "ROS 2 bridge": Closure("import vehicle.ros.bridge", {"vehicle", "controller"}, 34, 2_900),
    "page": Closure("import cockpit.page.node", {"cockpit.page", "vehicle.driver", "drive"}, 48, 5_140),
}

ROAD = ("perception", "supervisor", "controller", "vehicle", "drive", "cockpit")
OFFERED = {f"{package}.offers" for package in ROAD}
"""The tables of what the packages of a car offer, by which processes are planned."""
DRIVERS = (
    "import vehicle.actuators.table, vehicle.cameras.table\n"
    "assert all(map(vehicle.actuators.table.kind, vehicle.actuators.table.OWN))\n"
    "assert all(map(vehicle.cameras.table.kind, vehicle.cameras.table.OWN))"
)
WHOLE_CAR = Closure(
    "\n".join([*(one.statements for one in CLOSURES.values()), DRIVERS]),
    {"perception", "supervisor", "controller", "vehicle", "drive", "cockpit.page"},
    232,
    24_569,
)
"""All of a car: launcher, every node, every driver of cameras, actuators and driver input, bridge to ROS 2."""


@pytest.fixture(scope="module")
def shuttle(tmp_path_factory: pytest.TempPathFactory) -> Path:
    car = tmp_path_factory.mktemp("car") / "mycar"
    write_car(car, Like.SHUTTLE)
    return car


@pytest.mark.parametrize("entry", [*CLOSURES, "the whole car"])
def test_an_entry_of_a_real_car_loads_its_own_package_and_the_vocabulary_only(
    entry: str, shuttle: Path
) -> None:
    statements, packages, modules, lines = CLOSURES.get(entry, WHOLE_CAR)
    found = {name: count for name, count in loaded_modules(statements, {CAR: str(shuttle)}).items() if count}
    own = tuple(f"{package}." for package in packages | {"trepid"})
    foreign = sorted(name for name in found if not f"{name}.".startswith(own) and name not in OFFERED)
    assert foreign == []
    assert len(found) <= modules and sum(found.values()) <= lines, (len(found), sum(found.values()))


def test_the_measure_sees_the_simulator_where_it_is_loaded() -> None:
    found = loaded_modules("import sim_harness.live.vehicle_node", {})
    assert {"sim_harness.live.vehicle_node", "controller.limiter.limiter", "trepid.bus"} <= found.keys()
    assert {name.split(".")[0] for name in found} <= set(PACKAGES)


def test_a_line_of_code_is_neither_blank_nor_comment_nor_docstring() -> None:
    text = '"""Words.\n\nMore.\n"""\n\nA = (\n    1,  # one\n)\n'
    text += '\n\ndef f():\n    """Words."""\n    # a comment\n    return A\n'
    assert lines_of_code(text) == 5
