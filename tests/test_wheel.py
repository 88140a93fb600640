"""Wheel and sdist, installed into an environment of their own, work from an empty folder. Run by `make wheel`."""

import json
import re
from pathlib import Path

import cv2
import pytest
from drawn_road_rig import road
from page_rig import console_blocks
from wheel_rig import Installation, build_wheel, install_package

from trepid.clothoid import Lane
from trepid.config import ROOT

pytestmark = pytest.mark.wheel


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return build_wheel(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="module")
def wheel(packages: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Installation:
    return install_package(packages["wheel"], tmp_path_factory.mktemp("wheel"))


def test_the_list_of_verbs_is_printed(wheel: Installation) -> None:
    done = wheel.trepid("--help")
    assert done.returncode == 0, done.stderr
    assert "doctor" in done.stdout


def test_settings_weights_and_packages_are_those_of_the_installation(wheel: Installation) -> None:
    rows = [json.loads(line) for line in wheel.trepid("doctor", "--json").stdout.splitlines()]
    state = {row["check"]: row["ok"] for row in rows}
    assert state["packages"] and state["configuration"] and state["models"], rows


def test_a_car_of_each_template_is_written_and_used(wheel: Installation) -> None:
    for like in ("sim", "shuttle", "rc-car"):
        done = wheel.trepid("init", like, "--like", like)
        assert done.returncode == 0, done.stderr
    steer = ["vehicle", "steer", "--curvature", "0.1", "--speed", "0", "--json"]
    angles = [json.loads(wheel.trepid(*steer, "--car", car).stdout) for car in ("sim", "rc-car")]
    assert angles[0] != angles[1]


def test_images_are_estimated_by_every_estimator_of_the_drive(wheel: Installation) -> None:
    cv2.imwrite(str(wheel.work / "lane.png"), road(Lane(0.0, 0.0, 0.0, 0.0)))
    for estimator in ("cv", "cnn"):
        done = wheel.trepid("estimate", "--estimator", estimator, "--json", "lane.png")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["estimator"] == estimator


def test_the_laboratory_is_a_package_of_its_own(wheel: Installation) -> None:
    folders = {Path(file).parent.name for file in wheel.files()}
    assert {"results", "lab"}.isdisjoint(folders) and {"recording", "lockstep", "replay"} <= folders


def test_all_processes_drive_and_nothing_is_written_beside_the_packages(wheel: Installation) -> None:
    before, work = wheel.files(), set(wheel.work.iterdir())
    done = wheel.trepid("drive", "--duration", "10", "--no-dashboard", "--json")
    row = json.loads(done.stdout)
    assert row["departures"] == 0 and row["distance_m"] > 1.0, row["reasons"]
    assert wheel.files() == before
    assert set(wheel.work.iterdir()) == work


def test_examples_are_copied_and_run_and_the_page_of_a_service_exists(wheel: Installation) -> None:
    assert wheel.trepid("example", "copy", "night_bend").returncode == 0
    truth = ["--set", "sight=truth", "--set", "duration_s=3", "--json"]
    done = wheel.trepid("sim", "run", "night_bend.yaml", *truth)
    assert json.loads(done.stdout)["departures"] == 0, done.stderr
    assert wheel.trepid("init", "served", "--like", "shuttle").returncode == 0
    unit = Path(wheel.work / wheel.trepid("service", "served").stdout.split()[0]).read_text(encoding="utf-8")
    (page,) = [line.removeprefix("Documentation=file://") for line in unit.splitlines() if "file://" in line]
    assert Path(page).is_file()


def test_the_commands_of_the_first_fifteen_minutes_run_in_their_order(wheel: Installation) -> None:
    lines = [line for block in console_blocks("first_drive.md") for line in block]
    commands = [line.split()[1:] for line in lines if line.startswith("trepid ")]
    assert len(commands) >= 8
    for words in commands:
        if words[0] == "drive":
            continue  # the test above
        done = wheel.trepid(*words)
        assert done.returncode == 0, f"{words}: {done.stdout}{done.stderr}"


SHORTER = {
    '"duration_s": 20': '"duration_s": 1',
    "seeds=8, jobs=2": "seeds=2, jobs=2, settings={'duration_s': 1}",
    "=42": "=1",
}


@pytest.fixture(scope="module")
def reader(wheel: Installation) -> Installation:
    """What the Python of the pages reads."""
    for command in (
        "example copy config --force",
        "sim run straight --set duration_s=3 --record drive.mcap",
        "export drive.mcap clip.mp4",
    ):
        done = wheel.trepid(*command.split())
        assert done.returncode in (0, 1), done.stderr
    return wheel


@pytest.mark.parametrize("page", ["python.md", "latency.md"])
def test_the_python_of_a_page_runs_as_a_script(reader: Installation, page: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    (snippet,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    for whole, short in SHORTER.items():
        snippet = snippet.replace(whole, short)
    (reader.work / "snippet.py").write_text(snippet, encoding="utf-8")
    done = reader.run("python", "snippet.py", timeout_s=600)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr


def test_the_sdist_contains_the_same_files(
    packages: dict[str, Path], wheel: Installation, tmp_path: Path
) -> None:
    sdist = install_package(packages["sdist"], tmp_path)

    def names(installation: Installation) -> set[str]:
        files = {Path(file).relative_to(installation.environment) for file in installation.files()}
        return {file.as_posix() for file in files if "dist-info" not in file.as_posix()}

    assert names(sdist) == names(wheel)
    assert sdist.trepid("vehicle", "margins").returncode == 0
