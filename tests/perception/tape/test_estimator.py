"""The estimator `tape` on rendered tracks: bends of 1.5 lane widths, one line in sight, dashes, scales."""

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
import pytest

from perception.estimators import entry_of
from perception.tape.estimator import TapeLane
from perception.tape.settings import Lines, TapeSettings, YellowSide
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.road import Road, RoadSettings
from sim_harness.world.tracks import LOOKS, taped_track
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, load, using_car
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.scale import scaled_settings

LANE_M, SPEED_MPS, PERIOD_S = 0.22, 0.4, 0.08
FROM_M, BEND_AT_M, RAMP_M = 0.3, 0.55, 0.03  # a lap begins before the bend
Seen = list[tuple[float, float, SteeringEstimate]]


@cache
def lap(
    look: str, bend: float, aside_m: float = 0.0, *, to_m: float = 1.0, blind: bool = False, gain: float = 1.0
) -> Seen:
    """:func:`drive` on an oval with bends of ``bend`` lane widths."""
    road = Road(taped_track("oval", LOOKS[look], lane_width_m=LANE_M, bend=bend))
    return drive(road, "mini", to_m, aside_m=aside_m, blind=blind, gain=gain)


def drive(
    road: Road,
    car: str,
    to_m: float,
    *,
    aside_m: float = 0.0,
    blind: bool = False,
    gain: float = 1.0,
    period_s: float = PERIOD_S,
) -> Seen:
    """Station, true curvature and estimate up to ``to_m``, driven at a constant offset from the lane centre.

    ``blind``: the vehicle reports no yaw rate; ``gain``: of the speed and yaw rate that it reports.
    """
    with using_car(CONFIG_DIR / "cars" / car):
        camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        estimator = entry_of("tape").build(camera, vehicle)
        renderer, found = Renderer(road, camera, seed=1), []
        station_m, t_s = FROM_M, 0.0
        while station_m < to_m:
            x_m, y_m = road.position(station_m, aside_m)
            curvature_1pm = road.curvature_at(station_m)
            own_1pm = curvature_1pm / (1 - curvature_1pm * aside_m)
            image = renderer.render(x_m, y_m, road.heading_at(station_m), t_s=t_s, station_m=station_m)
            state = VehicleState(
                t_s=t_s,
                speed_mps=gain * SPEED_MPS,
                road_wheel_angle_rad=math.atan(vehicle.wheelbase_m * own_1pm),
                yaw_rate_radps=None if blind else gain * SPEED_MPS * own_1pm,
                driver_override=False,
            )
            estimate = estimator.step(Frame(t_s=t_s, image=image), state, now_s=t_s)
            found.append((station_m, curvature_1pm, estimate))
            station_m += SPEED_MPS * period_s / (1 - curvature_1pm * aside_m)
            t_s += period_s
    return found


def offset_m(estimate: SteeringEstimate) -> float:
    """Its lateral offset, which must be measured."""
    assert estimate.lateral_offset_m is not None, estimate.reason
    return estimate.lateral_offset_m


@pytest.mark.parametrize("bend", [1.5, -1.5])
def test_the_lane_is_kept_through_a_bend_of_one_and_a_half_lane_widths(bend: float) -> None:
    seen = lap("white_on_mat", bend, to_m=BEND_AT_M + 1.5 * LANE_M * math.pi + 0.2)[5:]
    assert np.mean([estimate.confidence > 0.5 for _, _, estimate in seen]) > 0.95
    assert max(abs(offset_m(estimate)) for _, _, estimate in seen) < 0.02
    headings_rad = [abs(estimate.heading_error_rad or 0.0) for _, _, estimate in seen]
    assert (
        np.quantile(headings_rad, 0.9) < 0.1 and max(headings_rad) < 0.2
    )  # the yaw rate steps by 0.1 rad a frame


def winding_road(first: float, then: float) -> Road:
    """A straight, a quarter of a circle of radius ``first``, at once one of ``then``, in lane widths, + = left."""
    bends = [
        (math.copysign(1 / LANE_M, bend) / abs(bend), abs(bend) * LANE_M * math.pi / 2)
        for bend in (first, then)
    ]
    segments: list[dict[str, object]] = [{"length_m": BEND_AT_M}]
    before_1pm = 0.0
    for bend_1pm, length_m in bends:
        segments.append({"length_m": RAMP_M, "curvature_1pm": (before_1pm, bend_1pm)})
        segments.append({"length_m": length_m - RAMP_M, "curvature_1pm": bend_1pm})
        before_1pm = bend_1pm
    segments += [{"length_m": RAMP_M, "curvature_1pm": (before_1pm, 0.0)}, {"length_m": 1.0}]
    track = taped_track("oval", LOOKS["duckie"], lane_width_m=LANE_M, bend=2.0).model_dump()
    return Road(
        RoadSettings.model_validate(track | {"name": "winding", "closed": False, "segments": segments})
    )


def path_end_error_m(road: Road, station_m: float, estimate: SteeringEstimate) -> float:
    """Distance of the end of the stated path from the lane centre, by the sum of its steps."""
    lane = Lane.of_message(estimate)
    assert lane is not None
    s_m, step_m = np.linspace(0.0, estimate.lookahead_m, 100, retstep=True)
    turned = lane.curvature_1pm * s_m + lane.curvature_rate_1pm2 * s_m**2 / 2 - lane.heading_rad
    end = -1j * lane.offset_m + np.sum(np.exp(1j * turned)[:-1]) * step_m
    stations_m = station_m + np.linspace(0.0, 1.5 * estimate.lookahead_m, 200)
    away = road.positions(stations_m, np.zeros(200)) - road.position(station_m, 0.0)
    return float(np.abs((away @ (1, 1j)) * np.exp(-1j * road.heading_at(station_m)) - end).min())


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize("then", [0.7, 0.55])
def test_a_bend_tighter_than_the_lane_is_wide_is_found_behind_one_to_the_other_side(
    turn: int, then: float
) -> None:
    road = winding_road(turn * 1.67, -turn * then)
    to_m = BEND_AT_M + (1.67 + then) * LANE_M * math.pi / 2
    seen = drive(road, "duckiebot", to_m, period_s=0.035)[8:]
    assert min(estimate.confidence for _, _, estimate in seen) > 0.5
    assert max(path_end_error_m(road, station_m, estimate) for station_m, _, estimate in seen) < 0.06


def test_the_curvature_of_a_bend_is_measured_in_it() -> None:
    bend_1pm = 1 / (1.5 * LANE_M)
    inside = [
        lane.curvature_at(0.1)
        for station_m, curvature_1pm, estimate in lap(
            "white_on_mat", 1.5, to_m=BEND_AT_M + 1.5 * LANE_M * math.pi + 0.2
        )
        if curvature_1pm > 0.99 * bend_1pm and 0.8 < station_m < 1.2 and (lane := Lane.of_message(estimate))
    ]
    assert len(inside) > 8
    assert np.median(inside) == pytest.approx(bend_1pm, rel=0.08)


@pytest.mark.parametrize("place_m", [0.03, -0.03])
def test_an_offset_in_the_bend_is_measured(place_m: float) -> None:
    found = [offset_m(estimate) for _, _, estimate in lap("white_on_mat", 2.0, place_m)[5:]]
    assert np.median(found) == pytest.approx(place_m, abs=0.006)


@pytest.mark.parametrize("look", ["duckie", "white_on_wood", "black_on_light", "blue_on_light"])
def test_tape_of_any_colour_gives_the_lane(look: str) -> None:
    seen = lap(look, 2.0)[5:]
    assert np.mean([estimate.confidence > 0.4 for _, _, estimate in seen]) > 0.9
    assert np.quantile([abs(offset_m(estimate)) for _, _, estimate in seen], 0.95) < 0.025


def test_a_speed_and_a_yaw_rate_that_are_a_tenth_wrong_leave_the_lane_in_its_place() -> None:
    seen = lap("white_on_mat", 1.5, to_m=BEND_AT_M + 1.5 * LANE_M * math.pi + 0.2, gain=0.9)[5:]
    assert max(abs(offset_m(estimate)) for _, _, estimate in seen) < 0.025


@pytest.mark.parametrize("bend", [1.5, -3.0])
def test_without_a_yaw_rate_the_lane_is_that_of_the_lines_in_sight(bend: float) -> None:
    """Less exact in a bend, whose inner line is not in sight."""
    seen = lap("duckie", bend, to_m=BEND_AT_M + abs(bend) * LANE_M * math.pi + 0.2, blind=True)[5:]
    assert np.mean([estimate.confidence > 0.5 for _, _, estimate in seen]) > 0.9
    assert max(abs(offset_m(estimate)) for _, _, estimate in seen) < LANE_M / 4


def test_without_a_yaw_rate_a_lane_ends_with_its_lines() -> None:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        road = Road(taped_track("oval", LOOKS["white_on_mat"], lane_width_m=LANE_M, bend=2.0))
        image = Renderer(road, camera, seed=1).render(
            *road.position(FROM_M, 0.0), road.heading_at(FROM_M), t_s=0.0
        )
        estimator = entry_of("tape").build(camera, vehicle)
        shown = [
            estimator.step(Frame(t_s=t_s, image=one), None, now_s=t_s).confidence
            for t_s, one in zip(
                np.arange(8) * PERIOD_S, [*[image] * 6, np.full_like(image, 128), image], strict=True
            )
        ]
    assert shown[5] > 0.9
    assert shown[6] == 0.0
    assert 0 < shown[7] < 0.3, "the frames in a row are counted from the beginning"


def test_the_boundaries_are_drawn_in_the_image() -> None:
    _, _, estimate = lap("white_on_mat", 1.5, to_m=0.5)[2]
    assert len(estimate.left_boundary_px) > 3 and len(estimate.right_boundary_px) > 3
    assert (
        np.mean([u for u, _ in estimate.left_boundary_px[:4]])
        < 160
        < np.mean([u for u, _ in estimate.right_boundary_px[:4]])
    )


def still(
    camera: Camera, vehicle: Vehicle, settings: TapeSettings, section: Mapping[str, object]
) -> SteeringEstimate:
    """The estimate of a standing car in the middle of a straight lane, after some frames."""
    track = taped_track("oval", LOOKS["white_on_mat"], lane_width_m=3.3, bend=3.0).model_dump()
    track["sections"] = [track["sections"][0] | section]
    renderer = Renderer(Road(RoadSettings.model_validate(track)), camera, seed=2)
    estimator = TapeLane(settings, 0.36, camera, vehicle)
    for number in range(6):
        t_s = PERIOD_S * number
        state = VehicleState(
            t_s=t_s, speed_mps=0.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        )
        image = renderer.render(1.0, 0.25, 0.0, t_s=t_s, station_m=1.0)
        estimate = estimator.step(Frame(t_s=t_s, image=image), state, now_s=t_s)
    return estimate


@cache
def large_world() -> tuple[Camera, Vehicle, TapeSettings]:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    large = scaled_settings(camera, 1 / vehicle.scale), vehicle.in_reference_world
    return *large, load(CONFIG_DIR / "tape.yaml", TapeSettings)


NONE: dict[str, object] = {"stroke": "none"}
WHITE: dict[str, object] = {"stroke": "solid", "width_m": 0.36}
YELLOW: dict[str, object] = {**WHITE, "paint": "yellow"}


def test_a_single_line_is_followed_where_the_user_says_so() -> None:
    camera, vehicle, settings = large_world()
    middle = settings.model_copy(update={"lane": settings.lane.model_copy(update={"lines": Lines.MIDDLE})})
    section = {"left": NONE, "right": NONE, "middle": WHITE}
    found = still(camera, vehicle, middle, section)
    assert offset_m(found) == pytest.approx(0.25, abs=0.1) and found.confidence > 0.5
    assert found.lanes_detected == 1
    between = still(camera, vehicle, settings, section)  # a line inside bounds no lane here
    assert between.lateral_offset_m is None or abs(offset_m(between) - 0.25) > 1.0


def test_a_yellow_line_bounds_the_lane_on_its_side_alone() -> None:
    """The car stands in the left half of a road; the lane is the right half, one lane width away."""
    camera, vehicle, settings = large_world()
    kept_left = settings.model_copy(
        update={"lane": settings.lane.model_copy(update={"yellow": YellowSide.LEFT})}
    )
    section = {"left": WHITE, "right": YELLOW, "right_lanes": [{"marking": WHITE}]}
    assert abs(offset_m(still(camera, vehicle, settings, section)) - 0.25) < 0.1
    wrong = still(camera, vehicle, kept_left, section)
    assert wrong.lateral_offset_m is None or abs(offset_m(wrong) - 3.55) < 0.3
    right = still(
        camera, vehicle, kept_left, {"left": YELLOW, "right": WHITE, "left_lanes": [{"marking": WHITE}]}
    )
    assert abs(offset_m(right) - 0.25) < 0.12


@pytest.mark.parametrize("floor", ["wood", "light_floor"])
def test_a_floor_without_lines_shows_no_lane(floor: str) -> None:
    """Joints of planks and tiles, and the edges of patches of sun, are no lines."""
    found = still(*large_world(), {"left": NONE, "right": NONE, "verge": floor, "window_light": 1.0})
    assert found.lateral_offset_m is None and found.confidence == 0.0
    assert found.reason == "no lines of a lane found"
