import math
from dataclasses import replace

import numpy as np
import pytest
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, road

from perception.camera.self_calibration import calibrate_by_images
from perception.camera.uncertainty import CameraBelief
from perception.estimators import entry_of
from perception.lane.agreement import apart
from perception.lane.outline import with_boundaries
from perception.net.confirmed import CONFIRMED, DENIED, UNCONFIRMED, ConfirmedNet, agreement_degree
from perception.net.steer_net import SteerNet
from trepid.messages import Frame, SteeringEstimate

FRAME = Frame(t_s=0.0, image=np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8))
NOTHING = SteeringEstimate.nothing(0.0, estimator="cnn", lookahead_m=8.0, reason="no road")


class Says:
    """An estimator that always answers the same."""

    def __init__(self, answer, camera=CAMERA):
        self.answer, self.camera = answer, camera
        self.belief = CameraBelief(camera.height_m, 0.2, camera.fx_px, 0.15)

    def through(self, camera):
        return Says(self.answer, camera)

    def step(self, frame, state, *, now_s):
        return self.answer


def lane(offset_m=0.0, confidence=0.9):
    return replace(
        NOTHING,
        lateral_offset_m=offset_m,
        heading_error_rad=0.0,
        curvature_1pm=0.0,
        confidence=confidence,
        reason="",
    )


def draw_lane(offset_m=0.0, confidence=0.8):
    return with_boundaries(lane(offset_m, confidence), CAMERA, VEHICLE)


def confirm(network, witness):
    return ConfirmedNet(Says(network), Says(witness), VEHICLE).step(FRAME, None, now_s=0.0)


def test_the_lane_that_the_witness_has_too_is_as_sure_as_both_are():
    found = confirm(lane(), draw_lane())
    assert found.confidence == pytest.approx(0.9 * 0.8) and found.reason == ""


@pytest.mark.parametrize("aside_m", [-1.2, 1.2])
def test_a_lane_beside_that_of_the_witness_has_no_confidence_and_a_reason(aside_m):
    found = confirm(lane(aside_m), draw_lane())
    assert found.confidence == 0.0 and found.reason == UNCONFIRMED
    assert found.lateral_offset_m == aside_m


def test_without_a_lane_of_the_witness_the_network_has_no_confidence():
    assert confirm(lane(), NOTHING).confidence == 0.0


def test_where_the_network_has_no_lane_there_is_none():
    assert confirm(NOTHING, draw_lane()) == NOTHING


def test_the_network_looks_through_the_camera_that_the_witness_has_measured():
    network, witness = Says(lane()), Says(draw_lane())
    both = ConfirmedNet(network, witness, VEHICLE)
    both.step(FRAME, None, now_s=0.0)
    assert both._network is network
    witness.camera = CAMERA.model_copy(update={"height_m": 1.2 * CAMERA.height_m})
    found = both.step(FRAME, None, now_s=0.04)
    assert both._network.camera is witness.camera
    assert found.left_boundary_px == with_boundaries(lane(), witness.camera, VEHICLE).left_boundary_px


def test_the_doubt_of_the_camera_is_part_of_that_of_the_lane():
    known = replace(lane(0.5), ahead_sigma_m=(0.1,) * 6)
    found = confirm(known, draw_lane(0.5))
    assert found.ahead_sigma_m[0] == pytest.approx(math.hypot(0.1, 0.5 * 0.2))


def test_the_confidence_falls_with_the_distance_of_the_boundaries():
    assert agreement_degree(0.0) == agreement_degree(CONFIRMED) == 1.0
    assert agreement_degree((CONFIRMED + DENIED) / 2) == pytest.approx(0.5)
    assert agreement_degree(DENIED) == agreement_degree(1.0) == agreement_degree(None) == 0.0


def test_lanes_are_apart_by_the_share_of_the_width_of_the_other():
    """A quarter of a lane to the left; a lane of twice the width has each edge half a lane further out."""
    aside = apart(draw_lane(-VEHICLE.lane_width_m / 4), draw_lane(), CAMERA.height_px)
    assert aside == pytest.approx(0.25, abs=0.02)
    wide = VEHICLE.model_copy(update={"lane_width_m": 2 * VEHICLE.lane_width_m})
    assert apart(with_boundaries(lane(), CAMERA, wide), draw_lane(), CAMERA.height_px) == pytest.approx(
        0.5, abs=0.02
    )
    assert apart(NOTHING, draw_lane(), CAMERA.height_px) is None


def test_a_measured_width_counts_before_that_of_the_car():
    wide = with_boundaries(replace(lane(), lane_width_m=2 * VEHICLE.lane_width_m), CAMERA, VEHICLE)
    assert wide.lane_width_m == 2 * VEHICLE.lane_width_m
    assert apart(wide, draw_lane(), CAMERA.height_px) == pytest.approx(0.5, abs=0.02)


def test_only_a_self_calibrated_camera_needs_a_witness():
    image = road((0.0, 0.0, 0.0, 0.0))
    entry = entry_of("cnn")
    assert isinstance(entry.build(CAMERA, VEHICLE), SteerNet)
    camera = calibrate_by_images([image], SETTINGS.self_calibration)
    assert isinstance(entry.build(camera, VEHICLE, assumed=True), ConfirmedNet)


def test_a_network_in_a_lane_of_another_width_than_its_own_is_doubted():
    """A road drawn for less than half the height looks wider than any lane of the training."""
    low = CAMERA.model_copy(update={"height_m": CAMERA.height_m / 2.4})
    image = road((0.2, 0.0, 0.0, 0.0), camera=low)
    camera = calibrate_by_images([image], SETTINGS.self_calibration)
    frame = Frame(t_s=0.0, image=image)
    alone = entry_of("cnn").build(camera, VEHICLE).step(frame, None, now_s=0.0)
    doubted = entry_of("cnn").build(camera, VEHICLE, assumed=True).step(frame, None, now_s=0.0)
    assert math.isclose(doubted.lateral_offset_m or 0.0, alone.lateral_offset_m or 0.0)
    assert doubted.confidence < max(alone.confidence / 2, 0.01)
