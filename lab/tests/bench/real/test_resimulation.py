from dataclasses import replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lab.bench.perception.unknown_camera import unknown_drive
from lab.bench.real import resimulation
from lab.bench.real.frames import Picture
from lab.bench.real.resimulation import bench_resimulation, row_of, scores, stretches_of
from sim_harness.footage.reprojection import PoseChange
from sim_harness.footage.resimulation import resimulate
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load

pytestmark = pytest.mark.long


@cache
def moments() -> tuple[Any, ...]:
    """The first moments of a winding drive, rendered once for all tests."""
    return tuple(islice(unknown_drive(5, 0).moments(), 160))


def pictures(pause_s: float = 0.0, *, count: int = 160, speed_mps: float | None = None) -> list[Picture]:
    """A rendered winding drive, with a pause after 20 frames."""
    drive = unknown_drive(5, 0)
    return [
        Picture(
            "drive",
            one.t_s + (pause_s if number >= 20 else 0.0),
            one.image,
            drive.camera,
            steering_rad=0.1,  # of wheels out of trim
            speed_mps=speed_mps,
        )
        for number, one in enumerate(moments()[:count])
    ]


def test_a_pause_ends_a_stretch_and_the_longer_part_counts():
    (stretch,) = stretches_of("set", iter(pictures(3.0, speed_mps=9.0)))
    assert len(stretch.drive.frames) == 140 and stretch.drive.t_s[0] == 0.0
    assert list(stretches_of("set", iter(pictures(3.0, count=120, speed_mps=9.0)))) == []  # 5 s


def test_the_speed_is_that_of_the_log_or_of_the_ground():
    true_mps = unknown_drive(5, 0).course.speed_mps
    (logged,) = stretches_of("set", iter(pictures(speed_mps=7.5)))
    (seen,) = stretches_of("set", iter(pictures()))
    assert set(logged.drive.speed_mps) == {7.5}
    assert seen.drive.speed_mps[0] == pytest.approx(true_mps, rel=0.1)


def test_the_path_is_that_of_the_images_whatever_the_steering_says():
    drive = unknown_drive(5, 0)
    (stretch,) = stretches_of("set", iter(pictures(speed_mps=drive.course.speed_mps)))
    true = np.array([drive.course.yaw_rate_radps(t_s) for t_s in stretch.drive.t_s])
    assert stretch.drive.yaw_rates_radps == pytest.approx(true, abs=0.25 * np.abs(true).max())


def test_the_scores_are_means_over_runs_and_sums_of_interventions():
    (stretch,) = stretches_of("set", iter(pictures(count=125, speed_mps=10.4)))
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    run = resimulate(stretch.drive, vehicle, start=PoseChange(left_m=0.5))
    never = np.zeros(len(run.t_s), bool)
    other = replace(run, interventions=run.interventions + 2, engaged=never, fear=run.fear + 0.1)
    found = scores([row_of(stretch, one) for one in (run, other)])
    assert found["runs"] == 2 and found["interventions"] == 2 * run.interventions + 2
    assert found["duration_s"] == pytest.approx(2 * run.duration_s)
    assert found["engaged_percent"] == pytest.approx(50 * run.engaged_share, abs=0.1)
    assert found["mean_fear"] == pytest.approx(run.fear.mean() + 0.05, abs=0.01)
    assert found["mean_speed_mps"] == pytest.approx(10.4)
    assert (other.row()["rms_offset_m"], other.row()["autonomy_percent"]) == (None, None)
    assert found["rms_from_path_m"] == run.row()["rms_offset_m"]


def test_an_interrupted_benchmark_continues_with_the_runs_that_are_left(tmp_path, monkeypatch):
    (tmp_path / "drive").mkdir()
    monkeypatch.setattr(resimulation, "WORK_DIR", tmp_path)
    monkeypatch.setattr(resimulation, "FOOTAGE", {"drive": None})
    driven: list[resimulation.Run] = []
    ends = [4]

    def row(run: resimulation.Run) -> dict[str, Any]:
        if len(driven) in ends:
            raise KeyboardInterrupt
        driven.append(run)
        numbers: dict[str, float] = dict.fromkeys(
            ("duration_s", "speed_mps", "interventions", "stops", "engaged_percent"), run.part
        )
        numbers |= dict.fromkeys(
            ("autonomy_percent", "rms_offset_m", "mean_fear", "lane_seen_percent"), run.left_m
        )
        return {"runs": int(run.part < 3), "causes": [], **numbers}

    monkeypatch.setattr(resimulation, "driven_row", row)
    with pytest.raises(KeyboardInterrupt):
        bench_resimulation(data=tmp_path)
    ends.clear()
    found = bench_resimulation(data=tmp_path)["by_set"]["drive"]
    assert len(driven) == len(set(driven)) == 12
    assert (found["runs"], found["duration_s"]) == (9, 9.0)


def test_without_any_set_there_is_one_line(tmp_path: Path):
    with pytest.raises(InputError, match=f"none of the sets {next(iter(resimulation.FOOTAGE))}"):
        bench_resimulation(data=tmp_path)
