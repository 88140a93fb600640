"""People, cyclists and animals from boxes: kinds, ground points with deviations, and tracks over ground."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fixed_detector import FixedDetector
from hypothesis import given
from hypothesis import strategies as st
from message_rig import state

from perception.lead.boxes import BoxSettings, _uncut
from perception.lead.detection import Detection
from perception.lead.finder import NODE, LeadFinder, blindness, lead_settings
from perception.lead.kinds import HEIGHTS_M, Box, detected_kinds, standing, with_cyclists
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load, parse, use_car
from trepid.messages import Frame, RoadUsers
from trepid.processes.settings import ProcessSpec
from trepid.topics import LEAD_VEHICLE, ROAD_USERS

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
PERIOD_S = 0.04
ALL = ("person", "cyclist", "animal")
IMAGE = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)


def box(ahead_m: float, left_m: float, height_m: float, kind: str = "person") -> Box:
    """The box of an upright one at this place, by the projection of the camera."""
    corners = Detection(ahead_m, left_m, 0.5, 0.9, height_m).pixels(CAMERA)
    assert corners is not None
    return Box(kind, np.array(corners, np.float32), 0.9)


@pytest.mark.parametrize(
    ("kind", "height_m"), [("person", 1.1), ("person", 1.8), ("cyclist", 1.7), ("animal", 0.6)]
)
@pytest.mark.parametrize("place", [(8.0, 0.5), (15.0, -3.0), (30.0, 4.0)])
def test_one_stands_where_the_lower_edge_of_its_box_is(
    place: tuple[float, float], kind: str, height_m: float
) -> None:
    found = standing(CAMERA, box(*place, height_m, kind))
    assert found is not None and found.kind == kind
    assert (found.ahead_m, found.left_m) == pytest.approx(place, rel=0.02, abs=0.05)
    assert found.height_m == pytest.approx(height_m, rel=0.02)


def test_the_deviation_grows_with_the_square_of_the_distance() -> None:
    """On a plane dx = x²·dy/(h·f): of boxes whose lower edge deviates by the same pixels, here those of EDGE_PX."""
    near, far = (standing(CAMERA, box(ahead_m, 0.0, 0.8)) for ahead_m in (20.0, 40.0))
    assert near is not None and far is not None and near.ahead_sigma_m and far.ahead_sigma_m
    ratio = ((far.ahead_m - CAMERA.x_m) / (near.ahead_m - CAMERA.x_m)) ** 2
    assert far.ahead_sigma_m / near.ahead_sigma_m == pytest.approx(ratio, rel=0.25)


def test_one_whose_legs_are_hidden_is_not_taken_for_a_far_one() -> None:
    """The upper half of a person behind a parked car: its lower edge alone would be twice as far or on the sky."""
    whole = box(10.0, 0.0, 1.8)
    upper = whole._replace(corners=whole.corners * (1, 1, 1, 0) + (0, 0, 0, whole.corners[[1, 3]].mean()))
    found = standing(CAMERA, upper)
    assert found is not None and found.ahead_sigma_m is not None
    greatest_m = CAMERA.x_m + 2 * (10.0 - CAMERA.x_m) * HEIGHTS_M["person"][1] / 1.8
    assert found.ahead_m <= greatest_m + 0.1
    assert found.ahead_m - 2 * found.ahead_sigma_m < 10.0 < found.ahead_m + 2 * found.ahead_sigma_m


def test_a_box_too_small_for_a_person_is_none() -> None:
    assert standing(CAMERA, box(10.0, 0.0, 0.4)) is None
    assert standing(CAMERA, box(10.0, 0.0, 0.4, "animal")) is not None


@given(left=st.floats(0, 319), top=st.floats(0, 239), width=st.floats(0.5, 319), height=st.floats(0.5, 239))
def test_every_box_gives_a_finite_place_ahead_or_none(
    left: float, top: float, width: float, height: float
) -> None:
    corners = np.array([left, top, min(left + width, 319.0), min(top + height, 239.0)], np.float32)
    for kind in ALL:
        found = standing(CAMERA, Box(kind, corners, 0.9))
        if found is not None:
            assert found.ahead_m > CAMERA.x_m and found.ahead_sigma_m is not None
            assert all(map(math.isfinite, (found.ahead_m, found.left_m, found.ahead_sigma_m)))


def flat(kind: str, left: float, top: float, right: float, bottom: float) -> Box:
    return Box(kind, np.array([left, top, right, bottom], np.float32), 0.8)


def test_a_person_on_a_bicycle_is_one_cyclist_and_a_bicycle_alone_is_parked() -> None:
    rider, bicycle = flat("person", 100, 80, 120, 130), flat("bicycle", 98, 105, 124, 140)
    (cyclist,) = with_cyclists([rider, bicycle])
    assert cyclist.kind == "cyclist" and cyclist.corners.tolist() == [98, 80, 124, 140]
    assert with_cyclists([bicycle]) == []
    beside = with_cyclists([rider, flat("bicycle", 150, 105, 176, 140)])
    assert [one.kind for one in beside] == ["person"]


@pytest.mark.parametrize(
    ("kinds", "detects"),
    [
        (("vehicle",), ()),
        (("vehicle", "bicycle"), ()),
        (("person",), ("person",)),
        (("person", "bicycle", "animal"), ALL),
        (("cyclist",), ("cyclist",)),
    ],
)
def test_a_detector_detects_the_kinds_of_its_classes(
    kinds: tuple[str, ...], detects: tuple[str, ...]
) -> None:
    assert detected_kinds(kinds) == detects


def test_only_an_inner_edge_of_a_part_cuts_a_box_off() -> None:
    whole, part = (0, 0, 320, 240), (80, 60, 320, 180)  # the right edge of the part is that of the image
    inside, left, right, below = (
        *((0.3, 0.3, 0.6, 0.6), (0.0, 0.3, 0.4, 0.6)),
        *((0.6, 0.3, 1.0, 0.6), (0.3, 0.5, 0.6, 0.999)),
    )
    boxes = np.array([inside, left, right, below], np.float32)
    assert _uncut(boxes, part, whole).tolist() == [True, False, True, False]
    assert _uncut(boxes, whole, whole).all()


def test_a_kind_may_have_a_calibration_of_its_own() -> None:
    given = {"layout": "ssd", "classes": {"person": [4], "animal": [20]}, "min_score": 0.1, "tile_share": 1.0}
    animals = {"calibrations": {"animal": {"bias": 5.5, "slope": 4.0}}}
    assert parse(given, BoxSettings, source=None).calibrations == {}
    assert parse(given | animals, BoxSettings, source=None).calibrations["animal"](0.2) == pytest.approx(
        0.5, abs=0.02
    )
    with pytest.raises(InputError, match="unknown kind 'animals'; did you mean 'animal'"):
        parse(
            given | {"calibrations": {"animals": animals["calibrations"]["animal"]}}, BoxSettings, source=None
        )


def test_a_list_of_classes_is_that_of_vehicles_as_in_earlier_versions() -> None:
    settings = parse(
        {"layout": "ssd", "classes": [18, 23], "min_score": 0.3, "tile_share": 1.0}, BoxSettings, source=None
    )
    assert settings.classes == {"vehicle": (18, 23)}


def test_an_unknown_kind_is_refused_with_the_nearest_one() -> None:
    with pytest.raises(InputError, match="unknown kind 'persons'; did you mean 'person'"):
        parse(
            {"layout": "ssd", "classes": {"persons": [4]}, "min_score": 0.3, "tile_share": 1.0},
            BoxSettings,
            source=None,
        )


def watch_walk(
    walk: tuple[float, float], own_mps: float, *, known: bool = True, frames: int = 50
) -> RoadUsers:
    """The people after noisy detections of one that walks at this velocity, 25 m ahead of a car at the start."""
    rng = np.random.default_rng(4)
    detector = FixedDetector([], ALL)
    finder = LeadFinder(detector, lead_settings(), CAMERA, VEHICLE)
    for n in range(frames):
        t_s = n * PERIOD_S
        ahead_m, left_m = 25.0 + (walk[0] - own_mps) * t_s, -3.0 + walk[1] * t_s
        deviation_m = 0.0015 * ahead_m**2
        seen = ahead_m + rng.normal(0, deviation_m), left_m + rng.normal(0, 0.01 * ahead_m)
        detector.detections = [Detection(*seen, 0.6, 0.9, 1.7, "person", deviation_m)]
        lead = finder.step(
            Frame(t_s=t_s, image=IMAGE), state(t_s, speed_mps=own_mps) if known else None, [], now_s=t_s
        )
        assert lead.confidence == 0, "a person is no vehicle to follow"
    assert finder.road_users is not None
    return finder.road_users


@pytest.mark.parametrize(
    ("walk", "own_mps"), [((0.0, 0.0), 6.0), ((0.0, 1.4), 4.0), ((-1.0, 0.0), 3.0), ((0.0, 2.0), 0.0)]
)
def test_a_track_has_the_velocity_over_ground(walk: tuple[float, float], own_mps: float) -> None:
    seen = watch_walk(walk, own_mps)
    assert (seen.kinds, seen.detects) == (("person",), ALL)
    assert (seen.x_mps[0], seen.y_mps[0]) == pytest.approx(walk, abs=0.6)
    assert seen.y_m[0] == pytest.approx(-3.0 + walk[1] * 49 * PERIOD_S, abs=0.3)


def test_without_the_motion_of_the_car_a_person_has_a_place_and_no_velocity() -> None:
    seen = watch_walk((0.0, 0.0), 0.0, known=False)
    assert len(seen.x_m) == 1 and math.isnan(seen.x_mps[0]) and math.isnan(seen.y_mps[0])


def test_a_single_detection_is_published_only_where_it_is_sure() -> None:
    for confidence, people in ((0.95, 1), (0.5, 0)):
        detector = FixedDetector([Detection(15.0, 1.0, 0.6, confidence, 1.7, "person", 0.5)], ALL)
        finder = LeadFinder(detector, lead_settings(), CAMERA, VEHICLE)
        finder.step(Frame(t_s=0.0, image=IMAGE), state(0.0), [], now_s=0.0)
        assert finder.road_users is not None and len(finder.road_users.kinds) == people


def test_an_image_that_cannot_be_used_gives_no_message_of_people() -> None:
    finder = LeadFinder(FixedDetector([], ALL), lead_settings(), CAMERA, VEHICLE)
    finder.step(Frame(t_s=0.0, image=IMAGE), state(0.0), [], now_s=0.0)
    finder.step(Frame(t_s=0.04, image=np.zeros((2, 2, 3), np.uint8)), state(0.04), [], now_s=0.04)
    assert finder.road_users is None


@pytest.fixture
def car(tmp_path: Path) -> Iterator[Path]:
    use_car(tmp_path)
    yield tmp_path
    use_car(None)


LEAD = ProcessSpec("lead", NODE, publishes=(LEAD_VEHICLE.key, ROAD_USERS.key))


BLIND = "the car is blind to people, cyclists, animals: "
FETCH = "`trepid detector fetch objectron`, then `detector: objectron` in lead.yaml"
RUN = "delete `lead: null` from processes.yaml"


def test_a_car_names_the_people_to_whom_it_is_blind_and_the_remedy(
    car: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert blindness([LEAD]) == BLIND + FETCH, "the embedded detector knows drawn vehicles only"
    assert blindness([]) == f"{BLIND}{RUN}, {FETCH}", "no process looks for people, and no detector is named"
    (car / "lead.yaml").write_text("detector: objectron\n", encoding="utf-8")
    monkeypatch.setattr("perception.lead.finder.fetched_detector", Path)
    assert blindness([LEAD]) == ""
    assert blindness([]) == BLIND + RUN, "a process is all that is missing"
    (car / "d.onnx").write_bytes(b"")
    (car / "lead.yaml").write_text(
        "detector: d.onnx\nboxes: {classes: {vehicle: [1], person: [0]}}\n", encoding="utf-8"
    )
    assert blindness([LEAD]) == f"the car is blind to cyclists, animals: {FETCH}"


@pytest.mark.parametrize("detector", ["objectron", "missing.onnx"])
def test_a_detector_that_is_not_on_this_machine_finds_nobody(
    car: Path, detector: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(car))
    (car / "lead.yaml").write_text(
        f"detector: {detector}\nboxes: {{classes: {{vehicle: [1], person: [0]}}}}\n", encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"not on this machine|no such detector"):
        blindness([LEAD])
    assert blindness([]) == f"{BLIND}{RUN}, {FETCH}", "no process needs it"


def test_the_detector_of_another_program_is_not_judged() -> None:
    assert blindness([ProcessSpec("radar", "my.radar", publishes=(ROAD_USERS.key,))]) == ""
