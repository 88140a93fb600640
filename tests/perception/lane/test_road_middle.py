"""The estimator cv of the middle of a road with lines, and which estimators know one (V03)."""

import math

import numpy as np
import pytest

from perception.estimators import ESTIMATORS, Unfit, build_beside, entry_of, estimators
from perception.lane.lane_cv import LaneCv
from perception.lane.road_middle import WIDTH_SIGMA_M, RoadMiddle
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.drawn import BendShape, MarkingKind, random_road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.scale import scaled_settings

LANE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
SPEED_MPS, PERIOD_S, ASIDE_M, FROM_M = 5.0, 0.08, 0.2, 18.0


def road_car(width_m: float) -> Vehicle:
    return Vehicle.model_validate({**LANE.model_dump(), "corridor": "road", "road_width_m": width_m})


def drive(kind: MarkingKind, shape: BendShape, *, frames: int = 12) -> list[tuple[float, SteeringEstimate]]:
    """Beside the middle line before a bend of two lanes: true offset from the middle, and the estimate."""
    road = random_road(kind, shape, np.random.default_rng(5))
    lane_m = road.settings.lane_width_m
    renderer = Renderer(road, CAMERA, seed=1)
    cv = entry_of("cv").build(CAMERA, road_car(2 * lane_m))
    found = []
    for number in range(frames):
        t_s, station_m = number * PERIOD_S, FROM_M + SPEED_MPS * number * PERIOD_S
        x_m, y_m = road.position(station_m, lane_m / 2 + ASIDE_M)
        image = renderer.render(x_m, y_m, road.heading_at(station_m), t_s=t_s, station_m=station_m)
        state = VehicleState(
            t_s=t_s,
            speed_mps=SPEED_MPS,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=SPEED_MPS * road.curvature_at(station_m),
            driver_override=False,
        )
        found.append((ASIDE_M, cv.step(Frame(t_s=t_s, image=image), state, now_s=t_s)))
    return found


@pytest.mark.parametrize("shape", [BendShape.STRAIGHT, BendShape.TIGHT])
@pytest.mark.parametrize("kind", [MarkingKind.WHITE, MarkingKind.DOUBLE, MarkingKind.WORN])
def test_the_offset_is_that_from_the_middle_line_and_the_corridor_is_as_wide_as_a_lane(kind, shape):
    for true_m, estimate in drive(kind, shape)[4:]:
        assert estimate.lateral_offset_m == pytest.approx(true_m, abs=0.08)
        assert estimate.lane_width_m == pytest.approx(LANE.lane_width_m, abs=WIDTH_SIGMA_M)
        assert estimate.confidence > 0.9


def test_a_car_in_its_lane_has_the_estimator_of_a_lane():
    assert type(entry_of("cv").build(CAMERA, LANE)) is LaneCv
    assert isinstance(entry_of("cv").build(CAMERA, road_car(7.0)), RoadMiddle)


def test_the_width_of_the_road_scales_with_its_lanes():
    small = scaled_settings(road_car(7.0), 0.15)
    assert small.in_reference_world.road_width_m == pytest.approx(7.0)
    assert entry_of("cv").build(scaled_settings(CAMERA, 0.15), small) is not None


def test_every_other_estimator_is_refused_by_name():
    for name, entry in estimators().items():
        if name != "cv" and not name.startswith("add"):
            unfit = entry.misfit and entry.misfit(CAMERA, road_car(7.0))
            assert isinstance(unfit, Unfit) and f"{name} does not measure the middle of the road" in unfit.why
    assert ESTIMATORS["cv"].misfit is None


def test_a_camera_without_a_file_knows_no_width_in_metres():
    from perception.camera.odometry import StateOdometry

    with pytest.raises(InputError, match="needs a camera file"):
        build_beside(["cv"], CAMERA, road_car(7.0), assumed=True, odometry=StateOdometry.NONE)


@pytest.mark.parametrize(
    ("fields", "fault"),
    [
        ({"corridor": "road"}, "road needs road_width_m"),
        ({"road_width_m": 7.0}, "only corridor: road reads it"),
        ({"corridor": "road", "road_width_m": 3.5}, "at least 1.2 lane_width_m wide"),
        ({"corridor": "road", "road_width_m": 7.0, "traffic": "right"}, "traffic keeps to a side"),
        ({"corridor": "kerb"}, "corridor"),
    ],
)
def test_fields_that_exclude_each_other_are_refused(fields, fault):
    with pytest.raises(ValueError, match=fault):
        Vehicle.model_validate({**LANE.model_dump(), **fields})


def test_the_default_is_the_lane():
    assert LANE.corridor == "lane" and LANE.road_width_m is None and math.isclose(LANE.scale, 1.0)
