"""The estimator `segments`: the lane of a drawn road from masks of its colours."""

from pathlib import Path

import numpy as np
import pytest
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, WHITE, road
from segment_rig import segmenter, write_network_of_car

from perception.estimators import entry_of, lane_cv_settings
from perception.lane.lane_cv import LaneCv
from perception.lane.street.pairs import boundaries, pairs
from perception.lane.street.profile import Profile, StreetCourse
from perception.segments.estimator import LaneFinder, Segments
from perception.segments.network import Masks
from perception.segments.picture import surface_width
from perception.segments.settings import lane_settings, network_description, network_file, segment_settings
from perception.segments.unknown_camera import LaneOfPictures
from trepid.car.camera import Camera
from trepid.config import InputError
from trepid.messages import Frame, SteeringEstimate

LOOKAHEAD_M = SETTINGS.steering.lookahead_m


def segments_in(folder: Path, **changes: object) -> Segments:
    return Segments(segmenter(folder, **changes), LaneCv(SETTINGS, CAMERA, VEHICLE), lookahead_m=LOOKAHEAD_M)


def finder_of(camera: Camera, *, known: bool) -> LaneFinder:
    own = segment_settings()
    if not known:
        return LaneOfPictures(lane_settings(SETTINGS, own), VEHICLE)
    settings = SETTINGS.model_copy(update={"confidence": own.confidence, "drawn_step_px": 1})
    return LaneCv(settings, camera, VEHICLE, guarded=True)


def look(estimator: Segments, image: np.ndarray, frames: int = 1) -> SteeringEstimate:
    for number in range(frames):
        seen = estimator.step(Frame(t_s=number / 25, image=image), None, now_s=number / 25)
    return seen


@pytest.mark.parametrize("lane", [(0.0, 0.0, 0.0, 0.0), (0.4, -0.05, 0.0, 0.0), (-0.3, 0.0, 0.01, 0.0)])
def test_the_lane_between_two_lines_is_measured(lane: tuple[float, ...], tmp_path: Path) -> None:
    seen = look(segments_in(tmp_path), road(lane))
    assert seen.estimator == "segments" and seen.lanes_detected == 2 and seen.confidence > 0.4
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.1)
    assert seen.heading_error_rad == pytest.approx(lane[1], abs=0.02)
    assert seen.curvature_1pm == pytest.approx(lane[2], abs=0.003)
    assert seen.lane_width_m == pytest.approx(3.4, abs=0.15)


def test_boundaries_lie_on_the_lines_in_the_pixels_of_the_image(tmp_path: Path) -> None:
    seen = look(segments_in(tmp_path), road((0.2, 0.02, 0.0, 0.0)))
    truth = LaneCv(SETTINGS, CAMERA, VEHICLE).step(
        Frame(t_s=0.0, image=road((0.2, 0.02, 0.0, 0.0))), None, now_s=0.0
    )
    for mine, other in (
        (seen.left_boundary_px, truth.left_boundary_px),
        (seen.right_boundary_px, truth.right_boundary_px),
    ):
        (x, y), (true_x, true_y) = np.array(mine).T, np.array(other).T
        rows = np.arange(max(y.min(), true_y.min()) + 20, min(y.max(), true_y.max()), 10.0)
        off = np.interp(rows, y[::-1], x[::-1]) - np.interp(rows, true_y[::-1], true_x[::-1])
        assert len(rows) > 10 and np.abs(off).max() < 6.0


@pytest.mark.parametrize("known", [True, False])
def test_boundaries_have_a_place_in_every_tenth_row_of_the_image(known: bool, tmp_path: Path) -> None:
    camera = CAMERA.model_copy(update={"height_m": 1.4, "pitch_down_rad": 0.02}).resize(1280, 720)
    image = road((0.1, 0.0, 0.0, 0.0), camera=camera)
    finder = finder_of(camera, known=known)
    seen = look(Segments(segmenter(tmp_path), finder, lookahead_m=LOOKAHEAD_M), image)
    for path in (seen.left_boundary_px, seen.right_boundary_px):
        rows = np.array(path)[:, 1]
        assert len(rows) > 20 and not (rows % 10).any() and (np.diff(rows) == -10).all()


def test_a_road_without_lines_is_measured_by_its_edges(tmp_path: Path) -> None:
    image = road((0.1, 0.0, 0.0, 0.0), width_m=3.2, left=None, right=None, verge_m=0.4)
    seen = look(segments_in(tmp_path), image, frames=8)
    assert seen.marked is False and seen.lateral_offset_m == pytest.approx(0.1, abs=0.2)


def test_a_network_of_lines_alone_suffices(tmp_path: Path) -> None:
    seen = look(segments_in(tmp_path, area=None), road((0.2, 0.0, 0.0, 0.0)))
    assert seen.lanes_detected == 2 and seen.lateral_offset_m == pytest.approx(0.2, abs=0.1)


def test_the_mirrored_image_has_the_mirrored_lane(tmp_path: Path) -> None:
    image = road((0.3, 0.04, 0.005, 0.0))
    seen, mirrored = look(segments_in(tmp_path), image), look(segments_in(tmp_path), image[:, ::-1])
    assert mirrored.lateral_offset_m == pytest.approx(-seen.lateral_offset_m, abs=0.05)
    assert mirrored.road_wheel_angle_rad == pytest.approx(-seen.road_wheel_angle_rad, abs=0.01)


@pytest.mark.parametrize("known", [True, False])
def test_a_surface_that_opens_to_both_sides_without_a_lane_is_called_a_junction(
    known: bool, tmp_path: Path
) -> None:
    """It is as wide as the image is at the greatest distance: d times the width over the focal length."""
    image = road((0.0, 0.0, 0.0, 0.0), left=None, right=None)
    rows = np.arange(CAMERA.height_px) - CAMERA.horizon_row_px
    image[rows > 0] = image[-1, CAMERA.width_px // 2]
    finder = finder_of(CAMERA, known=known)
    seen = look(Segments(segmenter(tmp_path), finder, lookahead_m=LOOKAHEAD_M), image)
    assert seen.confidence < 0.5 and "as at a junction" in seen.reason
    assert finder.camera is not None
    wide_m = surface_width(np.ones((192, 320), np.float32), finder.camera)
    assert wide_m == pytest.approx(25.0 * CAMERA.width_px / finder.camera.fx_px, rel=0.1)


def test_the_width_of_a_surface_is_measured_in_metres_and_a_blocked_way_has_none() -> None:
    aside_px = np.arange(CAMERA.width_px) - (CAMERA.width_px - 1) / 2
    scale_m = CAMERA.height_m / np.maximum(np.arange(CAMERA.height_px) - CAMERA.horizon_row_px, 1e-6)
    area = (np.abs(aside_px) * scale_m[:, None] < 3.0).astype(np.float32)
    assert surface_width(area, CAMERA) == pytest.approx(6.0, rel=0.1)
    area[:, CAMERA.width_px // 2] = 0.0
    assert surface_width(area, CAMERA) == 0.0


def test_an_image_without_a_road_gives_no_lane(tmp_path: Path) -> None:
    seen = look(
        segments_in(tmp_path), np.full((CAMERA.height_px, CAMERA.width_px, 3), (60, 120, 80), np.uint8)
    )
    assert seen.lateral_offset_m is None and seen.confidence == 0.0 and seen.reason


@pytest.mark.parametrize("image", [np.zeros((8, 8, 3), np.uint8), np.zeros((480, 640, 3), np.float32)])
def test_an_unusable_image_gives_the_reason(image: np.ndarray, tmp_path: Path) -> None:
    seen = look(segments_in(tmp_path), image)
    assert seen.estimator == "segments" and seen.lateral_offset_m is None and "image" in seen.reason


@pytest.mark.parametrize("pitch_rad", [0.02, 0.14])
def test_without_a_camera_file_the_lines_of_the_masks_give_the_horizon(
    pitch_rad: float, tmp_path: Path
) -> None:
    camera = CAMERA.model_copy(update={"pitch_down_rad": pitch_rad, "height_m": 1.4})
    image = road((0.1, 0.0, 0.0, 0.0), camera=camera)
    finder = LaneOfPictures(SETTINGS, VEHICLE)
    seen = look(Segments(segmenter(tmp_path), finder, lookahead_m=LOOKAHEAD_M), image)
    assert finder.camera is not None
    scale = camera.width_px / finder.camera.width_px
    assert finder.camera.horizon_row_px * scale == pytest.approx(camera.horizon_row_px, abs=25)
    assert seen.lanes_detected == 2 and seen.confidence > 0.5
    left, right = (np.array(path) for path in (seen.left_boundary_px, seen.right_boundary_px))
    assert left[0, 0] < camera.width_px / 2 < right[0, 0]


@pytest.mark.parametrize("paint", [None, WHITE])
def test_in_the_middle_of_a_road_for_both_ways_without_a_line_there_masks_are_not_sure(
    paint: tuple[int, int, int] | None, tmp_path: Path
) -> None:
    camera = CAMERA.model_copy(
        update={"fx_px": 288.0, "fy_px": 288.0, "height_m": 1.3, "pitch_down_rad": 0.0}
    )
    image = road((0.0, 0.0, 0.0, 0.0), width_m=6.2, left=paint, right=paint, verge_m=0.0, camera=camera)
    finder = LaneOfPictures(lane_settings(SETTINGS, segment_settings()), VEHICLE)
    assert look(Segments(segmenter(tmp_path), finder, lookahead_m=LOOKAHEAD_M), image).confidence < 0.5


def test_a_faint_line_in_its_middle_makes_a_lane_improbable_in_masks_more_than_in_camera_images() -> None:
    left_m = np.arange(7.0, -7.01, -0.1)
    dashed = np.where(np.abs(np.abs(left_m) - 2.0) < 0.06, 0.5, np.where(np.abs(left_m) < 0.06, 0.08, 0.0))
    nothing = np.zeros_like(left_m)
    course, seen = StreetCourse(0.0, 0.0, 0.3), np.ones(len(left_m), bool)
    camera = lane_cv_settings()
    masks = lane_settings(camera, segment_settings())
    probable = {}
    for name, settings in (("camera", camera.street.pairs), ("masks", masks.street.pairs)):
        for line, inside in ((dashed, True), (np.where(dashed > 0.1, dashed, 0.0), False)):
            profile = Profile(course, left_m, seen, line, nothing, nothing, nothing)
            found = boundaries(profile, settings)
            assert len(found) == 2, "the faint line is no boundary of its own"
            probable[name, inside] = pairs(profile, found, settings, height_sigma=0.2)[0].probability
    assert probable["camera", False] == probable["masks", False]
    assert probable["masks", True] < probable["camera", True] < probable["camera", False]


@pytest.mark.parametrize("broken", ["lines", "area"])
def test_masks_that_are_not_finite_are_no_lane_and_end_with_the_frame(broken: str, tmp_path: Path) -> None:
    network, image = segmenter(tmp_path), road((0.2, 0.0, 0.0, 0.0))
    sound = network(image)
    answers = [sound, sound._replace(**{broken: np.full_like(sound.lines, np.nan)}), sound]
    estimator = Segments(lambda _: answers.pop(0), LaneCv(SETTINGS, CAMERA, VEHICLE), lookahead_m=LOOKAHEAD_M)
    frames = [Frame(t_s=number / 25, image=image) for number in range(3)]
    before, during, after = (estimator.step(frame, None, now_s=frame.t_s) for frame in frames)
    assert during.lateral_offset_m is None and during.confidence == 0.0
    assert during.reason == "the network's output is not finite"
    for seen in (before, after):
        assert seen.lateral_offset_m == pytest.approx(0.2, abs=0.1)


@pytest.mark.parametrize("road_below", [0.0, 1.0])
@pytest.mark.parametrize("known", [True, False])
def test_a_bonnet_over_the_lowest_rows_of_the_masks_is_not_counted_as_road(
    known: bool, road_below: float, tmp_path: Path
) -> None:
    camera = CAMERA.model_copy(update={"height_m": 1.4, "pitch_down_rad": 0.02})
    network, image = segmenter(tmp_path), road((0.1, 0.0, 0.0, 0.0), camera=camera)

    def masks_under_bonnet(image: np.ndarray) -> Masks:
        masks = network(image)
        top = round(0.8 * len(masks.lines))
        for mask, value in zip(masks, (0.0, road_below), strict=True):
            mask[top:] = value
        return masks

    seen = []
    for masks_of in (network, masks_under_bonnet):
        estimator = Segments(masks_of, finder_of(camera, known=known), lookahead_m=LOOKAHEAD_M)
        seen.append(look(estimator, image, frames=4))
    bare, under = seen
    assert under.confidence > 0.85 * bare.confidence > 0.7
    assert under.lateral_offset_m == pytest.approx(bare.lateral_offset_m, abs=0.05)
    assert under.heading_error_rad == pytest.approx(bare.heading_error_rad, abs=0.01)


@pytest.mark.parametrize("known", [True, False])
@pytest.mark.parametrize("drivable", [0.0, 0.3])
def test_a_pavement_between_two_clear_lines_is_no_lane_that_is_sure(
    known: bool, drivable: float, tmp_path: Path
) -> None:
    camera = CAMERA.model_copy(update={"height_m": 1.4, "pitch_down_rad": 0.02})
    network, image = segmenter(tmp_path), road((0.1, 0.0, 0.0, 0.0), camera=camera)

    def masks_of_pavement(image: np.ndarray) -> Masks:
        masks = network(image)
        scale = masks.area.shape[1] / image.shape[1]
        right = np.array(seen[0].right_boundary_px)[::-1].T * scale
        beyond = np.interp(np.arange(len(masks.area)), right[1], right[0])
        masks.area[np.arange(masks.area.shape[1]) < beyond[:, None]] *= drivable
        return masks

    seen: list[SteeringEstimate] = []
    for masks_of in (network, masks_of_pavement):
        estimator = Segments(masks_of, finder_of(camera, known=known), lookahead_m=LOOKAHEAD_M)
        seen.append(look(estimator, image, frames=4))
    on_road, on_pavement = seen
    assert on_road.confidence > 0.7
    assert on_pavement.confidence <= drivable + 0.1
    assert on_pavement.reason


def test_a_network_that_was_not_fetched_is_named_with_the_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    with pytest.raises(InputError, match="`trepid networks fetch twinlitenet` gets it"):
        network_file(segment_settings())


def test_an_unknown_network_is_named_with_the_nearest_one() -> None:
    with pytest.raises(InputError, match="no network 'twinlitnet'; did you mean 'twinlitenet'"):
        network_description("twinlitnet")


def test_a_car_brings_a_network_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_network_of_car(tmp_path)
    monkeypatch.setenv("TREPID_CAR", str(tmp_path))
    own = entry_of("segments").build(CAMERA, VEHICLE)
    seen = own.step(Frame(t_s=0.0, image=road((0.2, 0.0, 0.0, 0.0))), None, now_s=0.0)
    assert seen.lateral_offset_m == pytest.approx(0.2, abs=0.1)
