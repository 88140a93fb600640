"""A plant by lateral acceleration: one that answers what the wheels would hold is the kinematic car."""

import math

import pytest
from message_rig import SHUTTLE
from plant_rig import command, drive

from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.lateral import LateralPlant
from sim_harness.world.plants.settings import AS_IN_THE_FILE
from sim_harness.world.plants.state import PlantState


class WholeAnswer(LateralPlant):
    """Answers ``share`` of what is demanded, and counts its answers."""

    share = 1.0

    def answer(self, state: PlantState, curvature_1pm: float, h: float) -> tuple[float, ...]:
        count = state.inner[1] if state.inner else 0.0
        return self.share * curvature_1pm * state.speed_mps**2, count + 1.0


class HalfAnswer(WholeAnswer):
    share = 0.5


@pytest.mark.parametrize("angle_rad", [0.1, -0.1, 0.0])
def test_the_whole_answer_drives_as_the_kinematic_car(angle_rad: float) -> None:
    ends = []
    for kind in (WholeAnswer, KinematicPlant):
        plant = kind(SHUTTLE, AS_IN_THE_FILE)
        ends.append(drive(plant, plant.initial(speed_mps=8.0), command(angle_rad), 3.0))
    answered, steered = ends
    assert (answered.x_m, answered.y_m) == pytest.approx((steered.x_m, steered.y_m), abs=0.1)
    assert answered.yaw_rad == pytest.approx(steered.yaw_rad, abs=0.01)


def test_half_of_the_answer_is_a_circle_of_twice_the_radius() -> None:
    plant = HalfAnswer(SHUTTLE, AS_IN_THE_FILE)
    angle_rad = plant.steady_angle_rad(0.02, 8.0)
    end = drive(plant, plant.initial(speed_mps=8.0, curvature_1pm=0.02), command(angle_rad), 2.0)
    assert plant.yaw_rate_radps(end) == pytest.approx(0.01 * 8.0, rel=1e-6)
    assert plant.lateral_accel_mps2(end) == pytest.approx(0.01 * 64.0, rel=1e-6)
    assert math.hypot(end.x_m, end.y_m) == pytest.approx(2 * 100.0 * math.sin(end.yaw_rad / 2), rel=1e-3)
    assert end.inner[1] > 100.0, "the model keeps its own numbers from step to step"


def test_before_the_first_answer_the_wheels_turn_the_car() -> None:
    plant = WholeAnswer(SHUTTLE, AS_IN_THE_FILE)
    start = plant.initial(speed_mps=8.0, curvature_1pm=0.02)
    assert start.inner == () and plant.yaw_rate_radps(start) == pytest.approx(0.16)
    assert plant.lateral_mps2(start) == pytest.approx(1.28)
