"""The lead detector: geometry, tracking, and the choice of the lead."""

import math
from dataclasses import replace

import numpy as np
import pytest
from fixed_detector import FixedDetector
from hypothesis import given
from hypothesis import strategies as st
from message_rig import state

from perception.lead.boxes import REAR_M, on_road
from perception.lead.detection import Detection, Platt, peaks
from perception.lead.finder import Corridor, LeadFinder, lead_settings, usable_lane
from perception.lead.tracker import Odometry, Tracker
from perception.lead.view import (
    CELL_COLUMNS,
    CELLS_LEFT_M,
    COLUMNS,
    DISTANCES_M,
    LOWEST_M,
    ROW_M,
    ROWS,
    STRIPS,
    LeadView,
    strip_pixels,
)
from supervisor.path.follow import judge_lead
from supervisor.supervisor import SupervisorSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, LeadVehicle, SteeringEstimate
from trepid.wire import from_cdr, to_cdr

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SETTINGS = lead_settings()
NOSE_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
PERIOD_S = 0.04


@pytest.mark.parametrize("ahead_m", [3.0, 12.0, 40.0])
def test_the_row_of_a_strip_at_the_road_is_where_the_road_is_in_the_image(ahead_m: float) -> None:
    pixels = strip_pixels(CAMERA, ahead_m)
    row = ROWS - 0.5 + LOWEST_M / ROW_M  # between two rows, where z = 0
    low, high = math.floor(row), math.ceil(row)
    ground = pixels[low] + (row - low) * (pixels[high] - pixels[low])
    left_m = (COLUMNS / 2 - 0.5 - np.arange(COLUMNS)) * 0.2
    road = np.column_stack([np.full(COLUMNS, CAMERA.x_m + ahead_m), CAMERA.y_m + left_m])
    assert ground == pytest.approx(CAMERA.pixel_from_road(road), abs=1e-6)


def test_a_picture_twice_as_large_gives_the_same_strips() -> None:
    small = np.zeros((240, 320, 3), np.uint8)
    small[140:170, 140:180] = 200
    large = np.repeat(np.repeat(small, 2, axis=0), 2, axis=1)
    one = LeadView(CAMERA).strips(small).astype(int)
    other = LeadView(CAMERA.resize(640, 480)).strips(large).astype(int)
    near = DISTANCES_M < 12  # far off both are sampled from the finest level, which differs
    assert np.abs(one - other)[near].mean() < 2.0


def test_a_mirrored_picture_gives_mirrored_strips() -> None:
    rng = np.random.default_rng(0)
    camera = CAMERA.model_copy(update={"cx_px": (CAMERA.width_px - 1) / 2})
    image = rng.integers(0, 255, (240, 320, 3), np.uint8)
    view = LeadView(camera)
    mirrored = view.strips(np.ascontiguousarray(image[:, ::-1])).astype(int)
    assert np.abs(view.strips(image)[:, :, ::-1].astype(int) - mirrored).mean() < 1.0


def test_cells_of_one_vehicle_merge_into_one_detection_and_two_vehicles_stay_two() -> None:
    cells = np.zeros((STRIPS, 4, CELL_COLUMNS), np.float32)
    for strip, column in ((10, 20), (11, 20), (10, 21), (3, 5)):
        cells[strip, 0, column] = 0.9 if column == 20 else 0.7
        cells[strip, 1, column] = {10: 0.5, 11: -0.5, 3: 0.0}[strip]  # both of them mean a place between
        cells[strip, 2, column] = {20: -0.2, 21: 0.2, 5: 0.0}[column]
    near, far = sorted(peaks(cells, 0.5))
    assert far[0] == pytest.approx(math.sqrt(DISTANCES_M[10] * DISTANCES_M[11]), rel=1e-3)
    assert far[1] == pytest.approx(CELLS_LEFT_M[20] - 0.2, abs=1e-6)
    assert (near[0], near[1]) == pytest.approx((DISTANCES_M[3], CELLS_LEFT_M[5]))


def test_platt_is_the_logistic_of_the_logit() -> None:
    assert Platt(bias=0.0, slope=1.0)(0.3) == pytest.approx(0.3)
    assert Platt(bias=1.0, slope=2.0)(0.5) == pytest.approx(1 / (1 + math.exp(-1.0)))


def test_a_box_stands_where_its_lower_edge_is() -> None:
    for place in ((15.0, 0.5), (30.0, -0.8)):
        there = Detection(*place, 1.8, 0.9)
        box = there.pixels(CAMERA)
        assert box is not None
        found = on_road(CAMERA, box, 0.9)
        assert found is not None
        assert (found.ahead_m, found.left_m, found.width_m) == pytest.approx((*place, 1.8), rel=1e-3)


def box_around(
    near_m: float, inner_m: float, width_m: float, length_m: float, turned_rad: float
) -> list[float]:
    """The box [px] of a cuboid on the road whose inner near corner stands at this place, right of the axis."""
    turn = complex(math.cos(turned_rad), math.sin(turned_rad))
    outline = (turn * complex(along, -across) for along in (0.0, length_m) for across in (0.0, width_m))
    places = [(near_m + one.real, CAMERA.y_m - inner_m + one.imag) for one in outline]
    columns, rows = CAMERA.pixel_from_road(places).T
    return [float(columns.min()), 80.0, float(columns.max()), float(rows.max())]


@given(
    st.floats(8.0, 30.0),
    st.floats(1.4, 3.0),
    st.floats(1.6, 2.5),
    st.floats(4.0, 9.0),
    st.sampled_from([1.0, -1.0]),
)
def test_a_vehicle_parked_beside_the_lane_stands_where_its_rear_stands(
    near_m: float, inner_m: float, width_m: float, length_m: float, side: float
) -> None:
    left, top, right, bottom = box_around(near_m, inner_m, width_m, length_m, 0.0)
    if side < 0.0:
        left, right = (2.0 * CAMERA.pixel_from_road([(9.0, CAMERA.y_m)])[0, 0] - end for end in (right, left))
    found = on_road(CAMERA, (left, top, right, bottom), 0.9)
    if found is None or found.width_m > REAR_M[1]:
        return  # a flank that makes the box too wide
    end_m = abs(found.left_m - CAMERA.y_m) - found.width_m / 2
    flat_m = inner_m * (near_m - CAMERA.x_m) / (near_m - CAMERA.x_m + length_m)
    assert flat_m - 1e-6 <= end_m <= 1.02 * inner_m  # the lens is pitched
    if length_m < 4.5:
        assert end_m == pytest.approx(inner_m, abs=0.12 * inner_m)
    assert math.copysign(1.0, found.left_m - CAMERA.y_m) == -side


@pytest.mark.parametrize("reaches_m", [0.2, 0.8])
@pytest.mark.parametrize("near_m", [5.0, 10.0, 20.0])
def test_a_vehicle_half_in_the_lane_still_reaches_into_it(near_m: float, reaches_m: float) -> None:
    found = on_road(CAMERA, box_around(near_m, reaches_m, 1.8, 4.5, 0.0), 0.9)
    assert found is not None
    assert -(found.left_m - CAMERA.y_m) - found.width_m / 2 <= 1.02 * reaches_m


@pytest.mark.parametrize("near_m", [6.0, 10.0])
def test_a_vehicle_that_stands_across_keeps_its_whole_width(near_m: float) -> None:
    box = box_around(near_m, 0.4, 3.6, 1.8, 0.0)  # of one that comes out of a side road
    found = on_road(CAMERA, box, 0.9)
    assert found is not None
    assert -(found.left_m - CAMERA.y_m) - found.width_m / 2 <= 0.41


@pytest.mark.parametrize("width_m", [0.8, 2.55, 3.5])
def test_a_motorcycle_a_truck_and_one_at_an_angle_are_vehicles(width_m: float) -> None:
    (left, bottom), (right, _) = CAMERA.pixel_from_road([(12.0, width_m / 2), (12.0, -width_m / 2)])
    found = on_road(CAMERA, (left, bottom - 40, right, bottom), 0.9)
    assert found is not None and found.width_m == pytest.approx(width_m, abs=0.02)


@pytest.mark.parametrize(
    "box", [(100.0, 60.0, 130.0, 80.0), (0.0, 100.0, 319.0, 200.0), (160.0, 90.0, 161.0, 150.0)]
)
def test_a_box_off_the_road_or_without_the_width_of_a_vehicle_is_dropped(box: tuple[float, ...]) -> None:
    assert on_road(CAMERA, box, 0.9) is None


@pytest.mark.parametrize("share", [0.91, 0.95, 1.0])
def test_a_box_about_as_wide_as_the_picture_at_its_lower_edge_is_no_vehicle(share: float) -> None:
    width, height = CAMERA.width_px, CAMERA.height_px
    left = (1 - share) / 2 * width
    for bottom in (0.93 * height, float(height)):
        assert on_road(CAMERA, (left, 0.4 * height, width - left, bottom), 0.9) is None


def test_the_widest_lorry_at_the_nearest_road_in_the_picture_is_a_vehicle() -> None:
    nearest_m = float(CAMERA.road_from_pixel([(CAMERA.cx_px, CAMERA.height_px - 1.0)])[0][0])
    feet_px = CAMERA.pixel_from_road([(nearest_m, 1.275), (nearest_m, -1.275)])
    (left, bottom), (right, _) = feet_px.tolist()
    found = on_road(CAMERA, (left, 0.0, right, bottom), 0.9)
    assert found is not None and found.width_m == pytest.approx(2.55, abs=0.01)


def test_a_point_goes_to_the_odometry_frame_and_back() -> None:
    odometry = Odometry()
    for _ in range(100):
        odometry.move(5.0, 0.3, 0.01)
    there = odometry.from_vehicle(12.0, -3.0)
    assert odometry.to_vehicle(there) == pytest.approx((12.0, -3.0))


def track_lead(lead_mps: float, own_mps: float, *, side: float = 1.0, frames: int = 100) -> Tracker:
    """Noisy detections of a lead that drives straight ahead of us."""
    rng = np.random.default_rng(3)
    tracker = Tracker(SETTINGS.track, eye_m=CAMERA.x_m)
    for n in range(frames):
        ahead_m = 20.0 + (lead_mps - own_mps) * n * PERIOD_S
        noise = rng.normal(0, 0.02), rng.normal(0, 0.1)
        seen = Detection(ahead_m * (1 + noise[0]), side * (0.5 + noise[1]), 1.8, 0.95)
        tracker.step([seen], speed_mps=own_mps, yaw_rate_radps=0.0, dt_s=PERIOD_S)
    return tracker


@pytest.mark.parametrize(("lead_mps", "own_mps"), [(5.0, 5.0), (3.0, 6.0), (0.0, 4.0)])
def test_a_track_has_the_speed_of_the_vehicle_over_ground(lead_mps: float, own_mps: float) -> None:
    (track,) = track_lead(lead_mps, own_mps).tracks
    assert track.state[2] == pytest.approx(lead_mps, abs=0.7)
    assert track.confidence > 0.9


def test_mirrored_detections_give_the_mirrored_track() -> None:
    (left,), (right,) = (track_lead(5.0, 5.0, side=side).tracks for side in (1.0, -1.0))
    assert left.state * (1, -1, 1, -1) == pytest.approx(right.state)


def test_the_confidence_of_an_undetected_vehicle_falls_until_its_track_is_dropped() -> None:
    tracker = track_lead(5.0, 5.0)
    confidences = []
    while tracker.tracks:
        confidences.append(tracker.tracks[0].confidence)
        tracker.step([], speed_mps=5.0, yaw_rate_radps=0.0, dt_s=PERIOD_S)
    assert confidences == sorted(confidences, reverse=True)
    assert len(confidences) * PERIOD_S <= SETTINGS.track.max_coast_s + PERIOD_S


def find_lead(detections: list[Detection], *, yaw_rate_radps: float = 0.0, known: bool = True) -> LeadVehicle:
    """The finder's answer after 20 frames with the same detections."""
    finder = LeadFinder(FixedDetector(detections), SETTINGS, CAMERA, VEHICLE)
    for n in range(20):
        t_s = n * PERIOD_S
        frame = Frame(t_s=t_s, image=np.zeros((240, 320, 3), np.uint8))
        own = state(t_s, yaw_rate_radps=yaw_rate_radps) if known else None
        answer = finder.step(frame, own, [], now_s=t_s)
    return answer


def test_of_two_vehicles_in_our_lane_the_nearer_is_the_lead() -> None:
    answer = find_lead([Detection(25.0, 0.1, 1.8, 0.95), Detection(12.0, -0.2, 1.8, 0.9)])
    assert answer.distance_m == pytest.approx(12.0 - NOSE_M, abs=0.2)
    assert answer.lateral_m == pytest.approx(-0.2, abs=0.05)


def test_a_vehicle_on_the_next_lane_is_not_the_lead() -> None:
    assert find_lead([Detection(15.0, 3.5, 1.8, 0.95)]).confidence == 0


def test_in_a_bend_the_vehicle_on_our_arc_is_the_lead() -> None:
    radius_m, ahead_m = 40.0, 15.0
    aside_m = ahead_m**2 / (2 * radius_m)
    on_arc, straight_on = Detection(ahead_m, aside_m, 1.8, 0.95), Detection(ahead_m, -1.0, 1.8, 0.95)
    answer = find_lead([on_arc, straight_on], yaw_rate_radps=5.0 / radius_m)
    assert answer.lateral_m == pytest.approx(aside_m, abs=0.3)


def test_without_a_detection_the_message_has_confidence_0_and_no_numbers() -> None:
    answer = find_lead([])
    assert (answer.confidence, answer.distance_m, answer.lateral_m, answer.speed_mps) == (0, None, None, None)


def test_without_odometry_there_is_no_speed() -> None:
    answer = find_lead([Detection(15.0, 0.0, 1.8, 0.95)], known=False)
    assert answer.distance_m is not None
    assert answer.speed_mps is None


@pytest.mark.parametrize("shape", [(240, 320, 3), (480, 640, 3), (240, 320), (120, 160, 4)])
def test_the_detector_gets_every_image_in_the_size_of_its_camera(shape: tuple[int, ...]) -> None:
    detector = FixedDetector([Detection(15.0, 0.0, 1.8, 0.95)])
    finder = LeadFinder(detector, SETTINGS, CAMERA, VEHICLE)
    finder.step(Frame(t_s=0.0, image=np.full(shape, 90, np.uint8)), state(0.0), [], now_s=0.0)
    assert detector.shape == (CAMERA.height_px, CAMERA.width_px, 3)
    assert len(finder.detections) == 1


def test_an_image_that_cannot_be_processed_is_no_road_without_vehicles() -> None:
    finder = LeadFinder(FixedDetector([]), SETTINGS, CAMERA, VEHICLE)
    answer = finder.step(Frame(t_s=1.0, image=np.zeros((2, 2, 3), np.uint8)), state(1.0), [], now_s=1.0)
    assert math.isnan(answer.confidence)
    assert math.isnan(from_cdr(to_cdr(answer), LeadVehicle).confidence)
    limits = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).validation
    assert judge_lead(answer, None, now_s=1.0, settings=limits).confidence is None


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan, 1e6])
@pytest.mark.parametrize("name", ["speed_mps", "yaw_rate_radps", "road_wheel_angle_rad"])
def test_an_impossible_state_costs_no_leader(name: str, value: float) -> None:
    finder = LeadFinder(FixedDetector([Detection(15.0, 0.0, 1.8, 0.95)]), SETTINGS, CAMERA, VEHICLE)
    for n in range(20):
        t_s = n * PERIOD_S
        frame = Frame(t_s=t_s, image=np.zeros((240, 320, 3), np.uint8))
        own = state(t_s)
        own = replace(own, **{name: value}) if n == 15 else own
        answer = finder.step(frame, own, [], now_s=t_s)
        if n >= 3:
            assert answer.confidence > 0.5
    assert answer.distance_m == pytest.approx(15.0 - NOSE_M, abs=0.3)
    assert answer.speed_mps is not None


def lane(t_s: float, confidence: float = 0.9, offset_m: float | None = 0.5) -> SteeringEstimate:
    nothing = SteeringEstimate.nothing(t_s, estimator="cv", lookahead_m=8.0, reason="")
    fields = {name: getattr(nothing, name) for name in SteeringEstimate.__dataclass_fields__}
    seen = dict(lateral_offset_m=offset_m, heading_error_rad=0.0, curvature_1pm=0.01, curvature_rate_1pm2=0.0)
    return SteeringEstimate(**fields | seen | {"confidence": confidence})


def test_the_fresh_lane_of_highest_confidence_is_used_and_no_stale_unsure_or_empty_one() -> None:
    sure, unsure, old = lane(1.0), lane(1.0, 0.4), lane(0.0)
    assert usable_lane(SETTINGS.choice, [unsure, sure, old, None], t_s=1.0) is sure
    assert usable_lane(SETTINGS.choice, [old, lane(1.0, 0.1), lane(1.0, offset_m=None)], t_s=1.0) is None


def test_the_corridor_is_the_lane_where_it_is_detected_and_our_arc_elsewhere() -> None:
    seen = Corridor(SETTINGS.choice, lane(1.0), 0.0, None, t_s=1.0)
    assert seen.centre_m(10.0) == pytest.approx(-0.5 + 0.01 * 100 / 2)
    arc = Corridor(SETTINGS.choice, None, -0.02, None, t_s=1.0)
    assert arc.centre_m(10.0) == pytest.approx(-1.0)
    assert arc.reaches_in_m(10.0, -1.0, 1.8) > 0 > arc.reaches_in_m(10.0, 3.0, 1.8)


@pytest.mark.parametrize("width_m", [-1.0, 1.0, 5.0])
def test_only_boundaries_give_the_corridor_another_width(width_m: float) -> None:
    def room_m(**changes: float | int) -> float:
        return Corridor(SETTINGS.choice, replace(lane(1.0), **changes), 0.0, None, t_s=1.0).reaches_in_m(
            10.0, 1.0, 1.8
        )

    assert room_m(lane_width_m=width_m) == room_m()
    assert room_m(lane_width_m=5.0, lanes_detected=2) == pytest.approx(
        room_m() + (5.0 - VEHICLE.lane_width_m) / 2
    )
