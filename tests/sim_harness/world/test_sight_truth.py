"""The true sight distance against closed forms, symmetries and the pixels of the rendered image."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.lockstep.closed_loop import build_parts, run
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.scenarios.traffic import BODIES, Shape
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.things import Thing, ThingShape
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Light, Section
from sim_harness.world.roads.disturbances import Disturbance
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint
from sim_harness.world.roads.features import RoadMark, Wall, WallKind
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from sim_harness.world.sight_lines import SightLines, Spot
from sim_harness.world.sight_truth import SightTruth, load_sight_settings
from trepid.car.camera import Camera
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
LIMIT_M = load_sight_settings().limit_m
LANE_M = 3.4
START = (10.0, 0.0, 0.0)
LONG = (Segment(length_m=400),)


def road(*marks: RoadMark, segments: tuple[Segment, ...] = LONG, **features: object) -> Road:
    section = Section(name="plain", start_m=0)
    look = {"name": "plain", "closed": False, "lane_width_m": LANE_M, "sections": (section,)}
    return Road(RoadSettings(**look, segments=segments, marks=marks, **features))


def crest(radius_m: float, *, at_m: float = 100.0) -> tuple[ElevationPoint, ...]:
    """Uphill to a vertical curve of constant radius that begins at a station, and ends at the opposite grade."""
    grade = 60.0 / radius_m
    return ElevationPoint(at_m=at_m, grade=grade), ElevationPoint(at_m=at_m + 120.0, grade=-grade)


STRAIGHT = road()


def of(kind: str, grade: float) -> Disturbance:
    return Disturbance(kind=kind, grade=grade)


def sight(*disturbances: Disturbance, vehicles=(), on: Road = STRAIGHT, station_m: float = 10.0):
    pose = (*on.position(station_m, 0.0), on.heading_at(station_m))
    return SightTruth(on, CAMERA, disturbances, seed=0).at(station_m, pose, vehicles)


def test_nothing_takes_the_sight_along_a_clear_straight_road():
    assert sight() == (LIMIT_M, "")


@pytest.mark.parametrize(
    ("grade", "range_m"), [(3, 100.0), (4, 50.0), (4.5, 2 / (1 / 50 + 1 / 25)), (5, 25.0)]
)
def test_fog_ends_the_sight_at_its_meteorological_optical_range(grade, range_m):
    distance_m, cause = sight(of("fog", grade))
    assert distance_m == pytest.approx(CAMERA.x_m + math.hypot(range_m, CAMERA.height_m), abs=0.1)
    assert cause == Cause.FOG


def test_extinctions_of_fog_and_rain_add():
    one, two, both = (
        3 / (sight(*which).distance_m - CAMERA.x_m)
        for which in ([of("fog", 3)], [of("rain", 5)], [of("fog", 3), of("rain", 5)])
    )
    assert both == pytest.approx(one + two, rel=2e-3)


@pytest.mark.parametrize("shape", [Shape.VAN, Shape.TRUCK])
def test_a_vehicle_in_the_lane_ends_the_sight_at_its_near_end(shape):
    body = BODIES[shape]
    distance_m, cause = sight(vehicles=[((60.0, 0.3, 0.02), body)])
    assert distance_m == pytest.approx(50.0 + body.rear_m, abs=0.1)
    assert cause == Cause.OCCLUDED


def test_vehicles_beside_a_straight_lane_hide_none_of_it():
    beside = [((40.0, side * 3.4, 0.0), BODIES[Shape.TRUCK]) for side in (-1, 1)]
    assert sight(vehicles=beside) == (LIMIT_M, "")


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_truck_inside_a_bend_hides_the_lane_behind_the_line_past_its_corner(sign):
    """On a circle about (0, R) the first hidden place lies on the line past the near front corner of the truck."""
    radius_m = 80.0
    bent = road(segments=(Segment(length_m=200, curvature_1pm=sign / radius_m),))
    truck = Body(rear_m=0.0, front_m=8.0, width_m=2.5, height_m=3.5)
    distance_m, cause = sight(vehicles=[((20.0, sign * 8.0, 0.0), truck)], on=bent, station_m=0.0)
    assert cause == Cause.OCCLUDED
    # The lens is at (1.2, 0); the rays that the truck cuts first pass its corner (28, 8 - 1.25).
    corner, lens = np.array([28.0, 6.75]), np.array([CAMERA.x_m, 0.0])
    ahead_m = np.arange(1.0, 80.0, 0.01)
    places = np.column_stack(
        [radius_m * np.sin(ahead_m / radius_m), radius_m * (1 - np.cos(ahead_m / radius_m))]
    )
    ray, to_corner = places - lens, corner - lens
    above = ray[:, 1] / ray[:, 0] > to_corner[1] / to_corner[0]
    assert distance_m == pytest.approx(ahead_m[np.argmax(above & (ray[:, 0] > 10))], abs=0.1)


def test_a_bend_ends_the_sight_where_the_lane_leaves_the_image():
    """On a circle the line to a place s ahead is turned by half the angle s/R against the tangent."""
    radius_m = 30.0
    bent = road(segments=(Segment(length_m=150, curvature_1pm=1 / radius_m),))
    camera = CAMERA.model_copy(update={"x_m": 0.0})
    distance_m, cause = SightTruth(bent, camera, seed=0).at(0.0, (0.0, 0.0, 0.0))
    cos_pitch, sin_pitch = math.cos(camera.pitch_down_rad), math.sin(camera.pitch_down_rad)
    half_rad = distance_m / radius_m / 2
    chord_m = 2 * radius_m * math.sin(half_rad)
    depth_m = chord_m * math.cos(half_rad) * cos_pitch + camera.height_m * sin_pitch
    assert camera.cx_px - camera.fx_px * chord_m * math.sin(half_rad) / depth_m == pytest.approx(
        -0.5, abs=0.5
    )
    assert cause == ""


@given(radius_m=st.floats(300.0, 2000.0), height_m=st.floats(0.8, 3.0), into_m=st.floats(0.0, 25.0))
@settings(max_examples=30, deadline=None)
def test_over_a_crest_of_constant_radius_the_sight_is_the_root_of_twice_height_times_radius(
    radius_m, height_m, into_m
):
    camera = CAMERA.model_copy(update={"height_m": height_m, "x_m": 0.0})
    hill = road(elevation=crest(radius_m))
    distance_m, cause = SightTruth(hill, camera, seed=0).at(100.0 + into_m, (100.0 + into_m, 0.0, 0.0))
    expected_m = math.sqrt(2 * height_m * radius_m)
    if expected_m < 120.0 - into_m:  # else the ground falls away only beyond the curve
        assert distance_m == pytest.approx(expected_m, abs=0.1)
        assert cause == Cause.CREST


@pytest.mark.parametrize("bank_rad", [-0.06, 0.06])
def test_a_bank_takes_no_sight(bank_rad):
    """Neither an even one in a bend nor one that rolls in and out."""
    bend = (Segment(length_m=40), Segment(length_m=20, curvature_1pm=(0.0, 0.01)))
    bend += (Segment(length_m=200, curvature_1pm=0.01),)
    for bank in (((0.0, bank_rad),), ((20.0, 0.0), (60.0, bank_rad), (90.0, -bank_rad))):
        points = tuple(BankPoint(at_m=at_m, bank_rad=rad) for at_m, rad in bank)
        for segments in (bend, LONG):
            leaning, level = (sight(on=road(segments=segments, **of)) for of in ({"bank": points}, {}))
            assert leaning.cause == level.cause == ""
            assert leaning.distance_m == pytest.approx(level.distance_m, rel=0.1)


def test_a_sag_and_an_even_grade_take_no_sight():
    for profile in ([(0.0, 0.08)], [(20.0, -0.05), (120.0, 0.05)]):
        points = [ElevationPoint(at_m=at_m, grade=grade) for at_m, grade in profile]
        assert sight(on=road(elevation=tuple(points))) == (LIMIT_M, "")


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("distance_m", [0.6, 1.5])
def test_a_wall_inside_a_bend_ends_the_sight_at_the_chord_that_touches_it(side, distance_m):
    """From a circle of radius R past one of radius r to the first again: an arc of 2·R·acos(r/R)."""
    radius_m = 60.0
    camera = CAMERA.model_copy(update={"x_m": 0.0})
    arc = (Segment(length_m=180, curvature_1pm=side / radius_m),)
    wall = Wall(side="left" if side > 0 else "right", from_m=0, to_m=180, distance_m=distance_m, height_m=2.0)
    walled = road(segments=arc, walls=(wall,))
    pose = (*walled.position(20.0, 0.0), walled.heading_at(20.0))
    seen = SightTruth(walled, camera, seed=0).at(20.0, pose)
    inner_m = radius_m - LANE_M / 2 - distance_m
    assert seen.distance_m == pytest.approx(2 * radius_m * math.acos(inner_m / radius_m), rel=0.01)
    assert seen.cause == Cause.OCCLUDED


def test_the_eye_sees_farther_over_a_lower_wall():
    arc = (Segment(length_m=180, curvature_1pm=1 / 60),)
    heights_m = (0.05, 0.3, 0.8, 1.6, 3.0)
    walls = [Wall(side="left", from_m=0, to_m=180, height_m=height_m) for height_m in heights_m]
    seen_m = [sight(on=road(segments=arc, walls=(wall,))).distance_m for wall in walls]
    assert seen_m == sorted(seen_m, reverse=True)
    assert seen_m[0] > 1.5 * seen_m[-1]
    assert seen_m[-2] == seen_m[-1]  # higher than the eye is high enough


DARK_FOG = 0.04  # a target in the own beam, in dense fog without daylight: 24.5 m in place of 23.9 m


@given(
    grade=st.floats(0.0, 5.0),
    more=st.floats(0.0, 2.0),
    kind=st.sampled_from(["fog", "night", "rain", "snow"]),
    fog=st.floats(0.0, 5.0),
)
@settings(max_examples=30, deadline=None)
def test_sight_never_grows_with_the_grade_but_for_the_airlight_that_darkness_takes_from_fog(
    grade, more, kind, fog
):
    worse = min(grade + more, 5.0)
    before_m = sight(of(kind, grade), of("fog", fog))[0]
    share = DARK_FOG if kind == "night" else 0.0
    assert sight(of(kind, worse), of("fog", fog))[0] <= (1 + share) * before_m + 0.05


def test_darkness_is_the_cause_at_night_and_fog_is_it_in_dense_fog_at_night():
    assert sight(of("night", 5)).cause == Cause.DARK
    assert 25 < sight(of("night", 5)).distance_m < sight(of("night", 3)).distance_m < 80
    assert sight(of("night", 5), of("fog", 1)).cause == Cause.DARK
    assert sight(of("fog", 5), of("night", 1)).cause == Cause.FOG


@pytest.mark.parametrize("curvature_1pm", [0.0, 1 / 60])
def test_sight_is_the_same_in_the_mirrored_world(curvature_1pm):
    camera, sights = CAMERA.model_copy(update={"cx_px": (CAMERA.width_px - 1) / 2}), []
    for sign in (-1, 1):
        bent = road(segments=(Segment(length_m=300, curvature_1pm=sign * curvature_1pm),))
        vehicles = [((45.0, sign * 9.0, sign * 0.3), BODIES[Shape.TRUCK]), ((80.0, 0.0, 0.0), Body())]
        sights.append(SightTruth(bent, camera, [of("fog", 2)], seed=0).at(0.0, (0.0, 0.0, 0.0), vehicles))
    assert sights[0].distance_m == pytest.approx(sights[1].distance_m, abs=1e-6)
    assert sights[0].cause == sights[1].cause


def test_a_model_of_the_road_has_the_sight_of_the_road_in_its_scale():
    small = Road(
        RoadSettings(
            name="model",
            closed=False,
            lane_width_m=3.3 / 10,
            segments=(Segment(length_m=40),),
            sections=(Section(name="plain", start_m=0),),
        )
    )
    camera = CAMERA.model_copy(update={"x_m": 0.12, "height_m": 0.145})
    truth = SightTruth(small, camera, [of("fog", 5)], seed=0)
    assert truth.at(1.0, (1.0, 0.0, 0.0)).distance_m == pytest.approx(sight(of("fog", 5)).distance_m / 10)


def changed_by_a_zebra(at_m: float, *disturbances: Disturbance, vehicles=()) -> float:
    """The greatest change of a grey level in the image by a zebra crossing painted at a station."""
    frames = [
        Renderer(one, CAMERA, seed=3, disturbances=disturbances).render(
            *START, t_s=1.0, station_m=10.0, vehicles=vehicles, light=Light(noise=0)
        )
        for one in (STRAIGHT, road(RoadMark(kind="zebra", at_m=at_m)))
    ]
    return float(np.abs(frames[0].astype(int) - frames[1]).max())


def test_beyond_the_sight_in_fog_paint_changes_hardly_a_pixel_and_within_it_does():
    end_m = 10.0 + sight(of("fog", 5)).distance_m
    assert changed_by_a_zebra(end_m, of("fog", 5)) <= 0.08 * changed_by_a_zebra(end_m)
    assert changed_by_a_zebra(10.0 + (end_m - 10.0) / 2, of("fog", 5)) > 10


def test_beyond_a_crest_paint_changes_no_pixel_and_before_it_does():
    hill = crest(500.0, at_m=20.0)
    end_m = 30.0 + sight(on=road(elevation=hill), station_m=30.0).distance_m
    frames = [
        Renderer(road(*marks, elevation=hill), CAMERA, seed=3).render(
            30.0, 0.0, 0.0, t_s=1.0, station_m=30.0, light=Light(noise=0)
        )
        for marks in ([], [stop_line(end_m + 2.0)], [stop_line(end_m - 18.0)])
    ]
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])


@pytest.mark.parametrize("kind", [kind for kind in WallKind if kind is not WallKind.TREES])
def test_behind_a_wall_paint_changes_no_pixel_and_before_it_does(kind):
    arc = (Segment(length_m=180, curvature_1pm=1 / 60),)
    wall = Wall(kind=kind, side="left", from_m=0, to_m=180, distance_m=0.8, height_m=2.4)
    plain = road(segments=arc, walls=(wall,))
    end_m = 20.0 + sight(on=plain, station_m=20.0).distance_m
    pose = (*plain.position(20.0, 0.0), plain.heading_at(20.0))
    frames = [
        Renderer(road(*marks, segments=arc, walls=(wall,)), CAMERA, seed=3).render(
            *pose, t_s=1.0, station_m=20.0, light=Light(noise=0)
        )
        for marks in ([], [stop_line(end_m + 6.0)], [stop_line(end_m - 6.0)])
    ]
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])


def test_a_trunk_ends_a_line_of_sight_and_the_gap_beside_it_does_not():
    avenue = road(walls=(Wall(kind="trees", side="left", from_m=0, to_m=80, distance_m=1.0),))
    lines = SightLines(avenue)
    eye = Spot(10.0, 10.0, 0.0, 1.4)
    trunk_m = float(avenue.settings.walls[0].trunks_m[4])
    aside_m = LANE_M / 2 + 1.0

    def beyond(through_m: float) -> Spot:
        """A place on the ground on the line from the eye over ``through_m``, three metres behind the row."""
        ahead_m = 10.0 + (through_m - 10.0) * (aside_m + 3.0) / aside_m
        return Spot(ahead_m, ahead_m, aside_m + 3.0, 0.0)

    assert not lines.are_free(eye, beyond(trunk_m))
    assert lines.are_free(eye, beyond(trunk_m + 4.0))
    assert lines.are_free(eye, beyond(trunk_m - 4.0))


def stop_line(at_m: float) -> RoadMark:
    return RoadMark(kind="stop_line", at_m=at_m, length_m=4.0)


def arrow(at_m: float) -> RoadMark:
    return RoadMark(kind="arrow_straight", at_m=at_m)


def test_behind_a_truck_paint_changes_no_pixel_and_before_it_does():
    truck = [((50.0, 0.0, 0.0), BODIES[Shape.TRUCK])]
    end_m = 10.0 + sight(vehicles=truck).distance_m
    frames = [
        Renderer(one, CAMERA, seed=3).render(
            *START, t_s=1.0, station_m=10.0, vehicles=truck, light=Light(noise=0)
        )
        for one in (STRAIGHT, road(arrow(end_m + 22.0)), road(arrow(end_m - 8.0)))
    ]
    assert np.array_equal(frames[0], frames[1])
    assert not np.array_equal(frames[0], frames[2])


def test_a_drive_without_images_gets_the_true_sight_and_one_with_images_states_it_beside_the_frame():
    seen, stated = [], []
    scenario = load_scenario("fog", {"sight": "truth", "duration_s": "1"})
    run(scenario, witness=lambda now: seen.append(now.statistics))
    parts = build_parts(load_scenario("fog", {"duration_s": "1"}), seed=0)
    expected = SightTruth(scenario.build_road(), CAMERA, scenario.disturbances, seed=0)
    _, truth = parts.vehicle.step(None, None, now_s=0.0)
    stated = parts.camera.shoot(truth, now_s=0.0)
    assert stated is not None and stated.frame is not None
    assert stated.sight == expected.at(truth.station_m, (truth.x_m, truth.y_m, truth.yaw_rad))
    statistics = next(one for one in seen if one is not None)
    assert (statistics.sight_m, statistics.sight_cause) == stated.sight
    assert statistics.sight_sigma_m == 0.0


def test_standing_vehicles_over_the_line_hide_the_lane_in_bends():
    circuit = load_road("circuit")
    stations = range(0, int(circuit.length_m), 15)
    clear = [sight(on=circuit, station_m=s) for s in stations]
    parked = [sight(of("occlusion", 5), on=circuit, station_m=s) for s in stations]
    assert all(b.distance_m <= a.distance_m for a, b in zip(clear, parked, strict=True))
    assert any(b.cause == Cause.OCCLUDED for b in parked)
    assert not any(a.cause for a in clear)


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_at_night_a_target_stands_out_of_the_noise_of_the_image_within_the_sight_and_not_beyond(share):
    """Rose's ratio of the drawn target: the sum of its change over σ·√n, with the noise of a patch of asphalt."""
    night, seed_frames = of("night", 5), range(3)
    section = Section(name="plain", start_m=0, patchiness=0, light=Light(noise=0))
    dark = Road(
        RoadSettings(
            name="dark",
            closed=False,
            lane_width_m=LANE_M,
            sections=(section,),
            segments=(Segment(length_m=400),),
        )
    )
    distance_m = sight(night, on=dark).distance_m * share
    side_m = load_sight_settings().target_side_m
    target = Thing(ThingShape.BLOCK, 0.02, side_m, side_m, (180, 180, 180))  # reflectance (180/255)² = 0.5
    ratios = []
    for seed in seed_frames:
        bare, lit = (
            Renderer(dark, CAMERA, seed=seed, disturbances=[night], things=things)
            .render(*START, t_s=1.0, station_m=10.0)
            .mean(axis=2)
            for things in ((), [((10.0 + distance_m, 0.0, 0.0), target)])
        )
        row = round(CAMERA.pixel_from_road([(distance_m, 0.0)])[0, 1])
        noise = bare[row - 1 : row + 2, 140:180].std()
        pixels = CAMERA.fx_px * CAMERA.fy_px * (side_m / (distance_m - CAMERA.x_m)) ** 2
        ratios.append((lit - bare).sum() / (noise * math.sqrt(max(pixels, 1.0))))
    needed = load_sight_settings().noise_multiple
    assert (np.mean(ratios) > needed) == (share < 1)


def test_the_modelled_detector_finds_no_vehicle_farther_in_fog_than_the_camera_sees():
    found = {}
    for grade in (0.0, 5.0):
        seen = []
        fog = f"[{{kind: fog, grade: {grade}}}]"
        near = {"sight": "truth", "lead_sensor": "modelled", "duration_s": "1", "traffic": "[{gap_m: 35}]"}
        run(
            load_scenario("straight", {**near, "disturbances": fog}),
            witness=lambda now, to=seen: to.append(now.lead),
        )
        found[grade] = any(lead is not None and lead.distance_m is not None for lead in seen)
    assert found == {0.0: True, 5.0: False}
