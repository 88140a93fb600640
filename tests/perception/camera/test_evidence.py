import math
from dataclasses import replace

import pytest

from perception.camera.evidence import CameraEvidence
from perception.camera.ground_fit import Optics
from perception.camera.uncertainty import CameraBelief
from trepid.car.camera import Camera

LOOKS, F = 5, 430.0
CAMERA = Camera(
    width_px=480, height_px=360, fx_px=F, fy_px=F, cx_px=239.5, cy_px=179.5,
    x_m=1.7, y_m=0.0, height_m=1.3, pitch_down_rad=0.03, yaw_rad=0.0,
)  # fmt: skip


def fresh() -> CameraEvidence:
    return CameraEvidence(
        CAMERA, CameraBelief(1.3, 0.2, F, 0.15), width_m=3.4, width_sigma_m=0.35, looks=LOOKS
    )


def optics(height_m: float, focal_px: float = F, *, turned: bool = True) -> Optics:
    return Optics(
        focal_height_pxm=focal_px * height_m,
        focal_height_sigma=0.005,
        focal_px=focal_px if turned else None,
        focal_sigma=0.01 if turned else math.inf,
        horizon_px=5.0,
        aside_px=0.0,
    )


def with_width(height_m: float) -> CameraEvidence:
    evidence = fresh()
    assert [evidence.add_width(3.4 / height_m) for _ in range(LOOKS)] == [False] * (LOOKS - 1) + [True]
    return evidence


def test_without_evidence_the_camera_is_the_assumed_one():
    evidence = fresh()
    assert evidence.camera is CAMERA and evidence.belief.height_m == 1.3 and evidence.awaits_dashes


def test_a_width_counts_once_and_only_after_several_looks():
    evidence = with_width(1.5)
    height_m = evidence.belief.height_m
    assert height_m == pytest.approx(1.5, rel=0.05)
    assert not any(evidence.add_width(3.4 / 1.2) for _ in range(2 * LOOKS))
    assert evidence.belief.height_m == height_m


def test_an_unlikely_width_leaves_room_for_a_later_likely_one():
    evidence = fresh()
    assert not any(evidence.add_width(7.5 / 1.3) for _ in range(LOOKS))
    assert [evidence.add_width(3.4 / 1.5) for _ in range(LOOKS)][-1]


def test_dashes_that_differ_from_frame_to_frame_do_not_count():
    evidence = fresh()
    periods = [0.9, 1.3, 1.0, 0.6, 1.5]
    assert not any(evidence.add_dashes(1.2 * F * 1.3 * share) for share in periods)
    assert evidence.awaits_dashes
    assert [evidence.add_dashes(1.2 * F * 1.3) for _ in range(LOOKS)][-1] and not evidence.awaits_dashes
    product = evidence.belief.height_m * evidence.belief.focal_px
    assert product == pytest.approx(1.2 * F * 1.3, rel=0.03)


def test_a_wrong_width_does_not_overrule_odometry_with_turns():
    evidence = with_width(1.0)  # two half lanes, taken for a lane
    assert evidence.add_optics(optics(1.9))
    assert evidence.belief.height_m == pytest.approx(1.9, rel=0.05)


def test_a_way_that_contradicts_the_width_changes_nothing():
    evidence = with_width(1.3)
    before = evidence.belief, evidence.camera
    assert not evidence.add_optics(optics(2.1, turned=False))  # at a speed 1.6 times too high
    assert (evidence.belief, evidence.camera) == before


def test_odometry_turns_the_camera_to_the_measured_horizon():
    evidence = fresh()
    evidence.add_optics(optics(1.4, turned=False))
    assert evidence.camera.horizon_row_px == pytest.approx(CAMERA.horizon_row_px - 5.0)


def test_the_order_of_evidence_does_not_matter():
    first, second = with_width(1.45), fresh()
    first.add_optics(optics(1.5, 400.0))
    second.add_optics(optics(1.5, 400.0))
    for _ in range(LOOKS):
        second.add_width(3.4 / 1.45)
    assert first.belief == second.belief and first.camera == second.camera


def test_later_straight_driving_keeps_the_focal_length_that_turns_have_measured():
    evidence = fresh()
    evidence.add_optics(optics(1.6, 470.0))
    before = evidence.belief
    assert not evidence.add_optics(optics(1.3, turned=False))
    assert evidence.belief == before and before.focal_px == pytest.approx(470.0, rel=0.01)


def test_lanes_of_an_unlikely_width_make_a_height_by_odometry_uncertain():
    evidence = fresh()
    evidence.add_optics(optics(1.7))  # at a speed 1.4 times too high
    assert evidence.belief.height_sigma < 0.06
    assert [evidence.add_width(3.4 / 1.2) for _ in range(LOOKS)][-1]
    assert evidence.belief.height_sigma == pytest.approx(math.log(1.7 / 1.2) / 2, rel=0.05)
    assert [evidence.add_width(3.4 / 1.6) for _ in range(LOOKS)][-1]  # then a likely one
    assert evidence.belief.height_sigma < 0.06


def test_an_impossible_height_by_odometry_changes_no_median_but_the_certainty():
    evidence = with_width(1.2)
    before = evidence.belief
    assert evidence.add_optics(optics(2.5))
    assert evidence.belief.height_m == before.height_m and evidence.camera.height_m == before.height_m
    assert evidence.belief.height_sigma == pytest.approx(math.log(2.5 / before.height_m) / 2, rel=0.01)


def test_without_a_turn_the_assumed_direction_of_the_camera_stays():
    evidence = fresh()
    evidence.add_optics(replace(optics(1.4, turned=False), aside_px=None))
    assert evidence.camera.yaw_rad == CAMERA.yaw_rad
