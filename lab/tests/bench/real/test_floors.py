"""The benchmark of floors: when an answer is right, and its file."""

from dataclasses import replace
from pathlib import Path

import pytest

from lab.bench.real import floors
from lab.bench.real.floors import Answer, DrawnLane, Floors, answers, apart, judge, on_floor, shares
from perception.estimators import entry_of
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, using_car
from trepid.messages import PixelPath, SteeringEstimate

LANE_M = 0.22


@pytest.fixture
def camera() -> Camera:
    return load(CONFIG_DIR / "cars" / "mini" / "camera.yaml", Camera)


@pytest.fixture
def vehicle() -> Vehicle:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        return load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def line_px(camera: Camera, y_m: float) -> PixelPath:
    """Pixels of a straight line along the car, ``y_m`` to its left."""
    pixels = camera.pixel_from_road([[x_m, y_m] for x_m in (0.2, 0.25, 0.3, 0.35, 0.4)])
    return tuple((float(u), float(v)) for u, v in pixels)


def estimate(left: PixelPath, right: PixelPath, confidence: float = 0.9) -> SteeringEstimate:
    nothing = SteeringEstimate.nothing(0.0, estimator="tape", lookahead_m=0.3, reason="")
    return replace(nothing, left_boundary_px=left, right_boundary_px=right, confidence=confidence)


def test_pixels_of_lines_on_the_floor_give_the_lines_back(camera: Camera) -> None:
    assert on_floor(line_px(camera, 0.11), camera)[:, 1] == pytest.approx([0.11] * 5, abs=1e-9)


@pytest.mark.parametrize(
    ("off", "right"), [(0.0, True), (0.15, True), (-0.15, True), (0.3, False), (1.0, False)]
)
def test_an_answer_is_right_up_to_a_fifth_of_a_lane_width(
    camera: Camera, vehicle: Vehicle, off: float, right: bool
) -> None:
    drawn = DrawnLane(left=line_px(camera, LANE_M / 2), right=line_px(camera, -LANE_M / 2))
    moved = [line_px(camera, side * LANE_M / 2 + off * LANE_M) for side in (1, -1)]
    assert judge(estimate(*moved), drawn, camera, vehicle).right is right


def test_a_side_that_is_not_drawn_is_not_asked_for_and_a_missing_answer_is_wrong(
    camera: Camera, vehicle: Vehicle
) -> None:
    left = line_px(camera, LANE_M / 2)
    assert judge(estimate(left, ()), DrawnLane(left=left, right=()), camera, vehicle).right
    assert not judge(estimate((), left), DrawnLane(left=left, right=()), camera, vehicle).right
    assert not judge(estimate((), ()), DrawnLane(left=(), right=()), camera, vehicle).answered


def test_the_distance_from_a_line_ends_at_its_ends() -> None:
    assert apart((1.0, 1.0), [(0.0, 0.0), (2.0, 0.0)]) == pytest.approx(1.0)
    assert apart((5.0, 4.0), [(0.0, 0.0), (2.0, 0.0)]) == pytest.approx(5.0)
    assert apart((5.0, 4.0), [(0.0, 0.0)]) == float("inf")


def test_right_and_confident_and_wrong_and_confident_are_shares_of_all_frames() -> None:
    found = [
        Answer(True, 0.9, True),
        Answer(True, 0.4, True),
        Answer(True, 0.6, False),
        Answer(False, 0.0, False),
    ]
    assert shares(found) == {
        "frames": 4,
        "answered": 0.75,
        "right": 0.5,
        "right_and_confident": 0.25,
        "wrong_and_confident": 0.25,
    }


def test_a_set_without_a_drawn_image_is_refused_with_its_name(tmp_path: Path, vehicle: Vehicle) -> None:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        floor = next(iter(load(Path(floors.__file__).with_name("floors.yaml"), Floors).floors.values()))
    (tmp_path / "other.jpg").write_bytes(b"")
    with pytest.raises(InputError, match=next(iter(floor.lanes))):
        answers(entry_of("tape"), floor, tmp_path, vehicle)


def test_every_camera_of_the_file_suits_the_estimator(vehicle: Vehicle) -> None:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        for floor in load(Path(floors.__file__).with_name("floors.yaml"), Floors).floors.values():
            entry_of("tape").build(floor.camera, vehicle)
            assert all(lane.left or lane.right for lane in floor.lanes.values())
