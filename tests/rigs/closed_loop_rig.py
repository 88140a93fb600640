"""The controller in closed loop on an S of clothoids."""

from controller_rig import SETTINGS, road


def s_clothoid(speed_mps, lateral_mps2=2.0, jerk_mps3=1.0):
    """Left and right at ``lateral_mps2``, entered at ``jerk_mps3``."""
    bend, entry = lateral_mps2 / speed_mps**2, speed_mps * lateral_mps2 / jerk_mps3
    arc = speed_mps * 2
    left = (entry, (0.0, bend)), (arc, bend), (entry, (bend, 0.0))
    right = (entry, (0.0, -bend)), (arc, -bend), (entry, (-bend, 0.0))
    return road([(speed_mps, 0.0), *left, *right, (speed_mps, 0.0)])


def generous(lateral_mps2):
    """Speed planning that leaves the speed alone where the test prescribes it."""
    speed = SETTINGS.speed.model_copy(update=dict(lateral_accel_mps2=lateral_mps2))
    return SETTINGS.model_copy(update=dict(speed=speed))


def worst_m(samples):
    return max(abs(one.offset_m) for one in samples)
