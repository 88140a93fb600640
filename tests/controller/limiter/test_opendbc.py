"""The limiter passes no command that opendbc's safety code in C rejects at the same limits.

``steer_angle_cmd_checks_vm`` of opendbc/safety/lateral.h compares every angle with the last and with a vehicle
model: lateral acceleration and jerk of 3.0 + 0.06·g. The wheel of opendbc leaves ``safety.c`` out; the few
lines that stand for it here only set the values that the car would report.
"""

import ctypes
import math
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from limiter_rig import SHIPPED, state
from message_rig import SHUTTLE, command, vehicle

from controller.limiter import Limiter

opendbc = pytest.importorskip("opendbc", reason="opendbc is not installed (pip install 'trepid[test]')")
COMPILER = shutil.which("cc") or shutil.which("gcc")
pytestmark = pytest.mark.skipif(COMPILER is None, reason="no C compiler")

THEIRS = 3.0 + 0.06 * 9.81  # m/s² and m/s³: "add tolerance to compensate" for banked bends
RATE_HZ = 100
CAN_PER_DEG = 1e4  # finer than any car's, so that opendbc's rounding by one unit is negligible
SHIM = r"""
#include <stdbool.h>
#include <stdint.h>
#include "opendbc/safety/tests/libsafety/fake_stm.h"
#include "opendbc/safety/can.h"
#include "opendbc/safety/safety.h"

void begin(int angle) {
  controls_allowed = true;
  desired_angle_last = angle;
  rt_angle_msgs = 0;
}

bool rejects(int angle, float speed, uint32_t now_us, float slip_factor, float steer_ratio, float wheelbase) {
  const AngleSteeringLimits limits = {.max_angle = 1 << 30, .angle_deg_to_can = 1e4, .frequency = 100};
  const AngleSteeringParams params = {slip_factor, steer_ratio, wheelbase};
  vehicle_speed.min = vehicle_speed.max = speed * VEHICLE_SPEED_FACTOR;
  timer_cnt = now_us;
  return steer_angle_cmd_checks_vm(angle, true, limits, params);
}
"""


@pytest.fixture(scope="module")
def safety(tmp_path_factory):
    """opendbc's check, compiled."""
    folder = tmp_path_factory.mktemp("opendbc")
    (folder / "shim.c").write_text(SHIM)
    root = Path(opendbc.__file__).parent.parent
    library = folder / "safety.so"
    flags = ["-std=gnu11", "-O1", "-w", "-shared", "-fPIC", "-I", str(root)]
    subprocess.run([COMPILER, *flags, "-o", str(library), str(folder / "shim.c")], check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.rejects.restype = ctypes.c_bool
    loaded.rejects.argtypes = [ctypes.c_int, ctypes.c_float, ctypes.c_uint32, *[ctypes.c_float] * 3]
    return loaded


def rejections(safety, steer, *, car, seed, seconds=6.0):
    """How many of the angles that ``steer(wanted, speed, accel, now)`` gives are rejected."""
    generator, count = np.random.default_rng(seed), 0
    speed = float(generator.uniform(0.5, 35.0))
    size = 10.0 ** generator.uniform(-2.0, 0.0)
    wanted = accel = 0.0
    safety.begin(0)
    for n in range(round(seconds * RATE_HZ)):
        if n % 20 == 0:
            wanted = size * float(generator.uniform(-1.0, 1.0))
            accel = float(generator.uniform(-4.0, 2.0))
        angle_rad, granted = steer(wanted, speed, accel, n / RATE_HZ)
        angle = round(math.degrees(angle_rad) * car.steering_ratio * CAN_PER_DEG)
        slip = -car.understeer_gradient_rad_per_mps2 / car.wheelbase_m
        count += safety.rejects(angle, speed, n * 10_000, slip, car.steering_ratio, car.wheelbase_m)
        speed = max(0.0, speed + granted / RATE_HZ)
    return count


def limiter_steering(car, scale=1.0):
    """Steers through the limiter at opendbc's limits."""
    same = SHIPPED.model_copy(
        update=dict(
            lateral_accel_mps2=scale * THEIRS,
            lateral_jerk_mps3=scale * THEIRS,
            lateral_accel_share=1.0,
            lateral_jerk_share=1.0,
            override=SHIPPED.override.model_copy(update=dict(angle_rad=9.0, fade_in_s=1e-9)),
        )
    )
    one = Limiter(car, same)

    def steer(wanted, speed, accel, now_s):
        requested = command(now_s, road_wheel_angle_rad=wanted, accel_mps2=accel)
        out = one.step(requested, now_s, state(now_s, speed_mps=speed), now_s=now_s)
        return out.road_wheel_angle_rad, out.accel_mps2

    return steer


CARS = {
    "shuttle": SHUTTLE,
    "saloon": vehicle(wheelbase_m=2.7, understeer_gradient_rad_per_mps2=0.0025, steering_ratio=15.0),
    "neutral": vehicle(wheelbase_m=2.9, understeer_gradient_rad_per_mps2=0.0, steering_ratio=12.0),
}


@pytest.mark.parametrize("name", CARS)
def test_opendbc_rejects_nothing_that_the_limiter_passes_at_its_limits(safety, name):
    car = CARS[name]
    assert sum(rejections(safety, limiter_steering(car), car=car, seed=seed) for seed in range(12)) == 0


def test_opendbc_rejects_unlimited_commands_and_commands_a_fifth_beyond(safety):
    """Shows that the test above can fail."""
    bare = sum(rejections(safety, lambda w, v, a, t: (w, a), car=SHUTTLE, seed=seed) for seed in range(5))
    assert bare > 100
    assert (
        sum(rejections(safety, limiter_steering(SHUTTLE, 1.2), car=SHUTTLE, seed=seed) for seed in range(10))
        > 100
    )


def test_the_shipped_limits_are_within_iso_and_below_the_acceleration_of_opendbc():
    assert SHIPPED.lateral_accel_share * SHIPPED.lateral_accel_mps2 < THEIRS
    assert SHIPPED.lateral_jerk_share * SHIPPED.lateral_jerk_mps3 < SHIPPED.lateral_jerk_mps3
