"""One reader of text for all formats: a file means the same in every encoding, and its numbers in every dialect."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drive_rig import START_S, write_table, write_tub
from rule_rig import FALLING, RISING, small_rules

from cockpit.calibration.drive_log import read_log as read_identification_log
from cockpit.rulebook.fcl_export import fcl
from cockpit.rulebook.fcl_read import parse_fcl
from learning.dataset.build import read_log
from learning.dataset.sources.log import Faults
from learning.dataset.sources.table import TableOptions
from sim_harness.compare.api import read_runs
from sim_harness.footage.clip import read_log as read_speeds
from sim_harness.footage.frame_fear import given_motion
from sim_harness.tuning.numbers import NumberedText
from sim_harness.world.opendrive.export import write_opendrive
from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.road_file import load_road
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import RuleFile
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, read_text
from vehicle.actuators.can.signal_map import load_map

ENCODINGS = ("utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32")
LIKE = load(CONFIG_DIR / "fear.yaml", RuleFile)
RULES = small_rules(
    "if a is high then fear is high because dark",
    "if b is low then trust_cv is low",
    inputs={"a": RISING, "b": FALLING},
    estimators=("cv",),
)


def camera(path: Path) -> Path:
    file = path / "camera.yaml"
    file.write_text((CONFIG_DIR / "camera.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    return file


def rules(path: Path) -> Path:
    file = path / "fear.yaml"
    file.write_text((CONFIG_DIR / "fear.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    return file


def control_language(path: Path) -> Path:
    file = path / "rules.fcl"
    file.write_text(fcl(RULES), encoding="utf-8")
    return file


def can_database(path: Path) -> Path:
    for name in ("shuttle.dbc", "map.yaml"):
        (path / name).write_bytes((CONFIG_DIR / "cars" / "shuttle" / "can" / name).read_bytes())
    return path / "shuttle.dbc"


def road(path: Path) -> Path:
    write_opendrive(load_road("town").settings, path / "town.xodr")
    return path / "town.xodr"


def manifest(path: Path) -> Path:
    return write_tub(path / "tub", 8) / "manifest.json"


def catalog(path: Path) -> Path:
    return write_tub(path / "tub", 8) / "catalog_0.catalog"


def runs(path: Path) -> Path:
    file = path / "runs.jsonl"
    file.write_text(json.dumps({"scenario": "Straße", "seed": 1, "status": "ok"}) + "\n", encoding="utf-8")
    return file


def write_log(path: Path) -> Path:
    t_s = [START_S + 0.02 * n for n in range(12)]
    names = ("speed_mps", "road_wheel_angle_rad", "yaw_rate_radps")
    columns = {name: np.linspace(0.1, 0.9, 12).tolist() for name in names}
    return write_table(path, {"image": [f"{n}.jpg" for n in range(12)], "t_s": t_s, **columns})


def tub_of(file: Path) -> Any:
    log = read_log(file.parent, Faults(strict=True), TableOptions())
    return log.steering.tolist(), log.t_s.tolist(), log.image, log.notes


def table_of(file: Path) -> Any:
    log = read_log(file, Faults(strict=True), TableOptions())
    return log.steering.tolist(), log.t_s.tolist(), log.image, log.speed_mps.tolist()


def motion_of(file: Path) -> Any:
    motion = given_motion(None, file)
    assert motion is not None and motion.yaw_radps_at is not None
    return [column.tolist() for column in read_speeds(file)], motion.yaw_radps_at(0.1)


def identify(file: Path) -> Any:
    log = read_identification_log(file)
    return [column.tolist() for column in (log.t_s, log.speed_mps, log.angle_rad, log.yaw_rate_radps)]


def database_of(file: Path) -> Any:
    found = load_map(file.parent / "map.yaml", load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    return {name: str(message.signals) for name, message in found.messages.items()}


FORMATS: dict[str, tuple[Callable[[Path], Path], Callable[[Path], Any]]] = {
    "settings": (camera, lambda file: load(file, Camera)),
    "rule file": (rules, lambda file: FearRules.load(file).file),
    "rule file to tune": (rules, lambda file: NumberedText(file).text),
    "FCL": (control_language, lambda file: parse_fcl(read_text(file, windows=True), source=file, like=LIKE)),
    "DBC": (can_database, database_of),
    "OpenDRIVE": (road, lambda file: read_opendrive(file).settings),
    "manifest of a tub": (manifest, tub_of),
    "catalog of a tub": (catalog, tub_of),
    "runs": (runs, read_runs),
    "table of a data set": (write_log, table_of),
    "table of speeds": (write_log, motion_of),
    "table of a drive": (write_log, identify),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
@pytest.mark.parametrize("form", FORMATS)
def test_a_file_means_the_same_in_every_encoding(tmp_path: Path, form: str, encoding: str) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    expected, text = read(file), file.read_text(encoding="utf-8")
    assert text
    file.write_text(text, encoding=encoding)
    assert read(file) == expected


@pytest.mark.parametrize("form", ["table of a data set", "table of speeds", "table of a drive"])
@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
def test_a_table_means_the_same_in_every_dialect(
    tmp_path: Path, form: str, separator: str, comma: bool
) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    expected, text = read(file), file.read_text()
    text = text.replace(",", separator)
    if comma:
        text = text.replace(".", ",").replace(",jpg", ".jpg")
    file.write_text(text)
    assert read(file) == expected


@pytest.mark.parametrize("form", ["table of a data set", "table of speeds", "table of a drive"])
def test_rounded_times_of_a_table_are_called_so(tmp_path: Path, form: str) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    header, *rows = [line.split(",") for line in file.read_text().splitlines()]
    at = header.index("t_s")
    rounded = [[*row[:at], f"{float(row[at]):.5E}", *row[at + 1 :]] for row in rows]
    file.write_text("\n".join(",".join(row) for row in [header, *rounded]))
    with pytest.raises(InputError, match="t_s: 12 rows have 1 time: rounded, as by a spreadsheet"):
        read(file)


@pytest.mark.parametrize("form", ["DBC", "FCL", "table of a data set"])
def test_a_file_in_the_code_page_of_windows_means_the_same(tmp_path: Path, form: str) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    expected, text = read(file), file.read_text(encoding="utf-8")
    remark = {"DBC": '\nCM_ "größer – gemessen";\n', "FCL": "\n// größer – gemessen\n"}.get(form)
    text = text + remark if remark else text.replace("\n", ",Straße\n").replace("Straße", "Bemerkung", 1)
    file.write_bytes(text.encode("cp1252"))
    assert read(file) == expected


@pytest.mark.parametrize("form", ["settings", "OpenDRIVE", "table of speeds"])
def test_a_file_of_zero_bytes_is_refused_by_its_name(tmp_path: Path, form: str) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    file.write_bytes(bytes(file.stat().st_size))
    with pytest.raises(InputError, match=rf"{file.name}:1:1: .*only zero bytes, as after a loss of power"):
        read(file)


@pytest.mark.parametrize("form", ["table of a data set", "table of a drive"])
def test_a_table_is_one_by_its_name_in_capitals_too(tmp_path: Path, form: str) -> None:
    write, read = FORMATS[form]
    file = write(tmp_path)
    expected = read(file)
    assert read(file.rename(file.with_suffix(".CSV"))) == expected
