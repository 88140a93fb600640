"""An input of the fear rules: how much the yaw rate contradicts the lanes that the estimators see."""

from supervisor.situation.added import Moment, fear_input

WORST_RADPS = 2.0


@fear_input(low=0.0, high=WORST_RADPS)
def yaw_doubt(moment: Moment) -> float | None:
    """Greatest difference between the yaw rate and v·κ of the lanes [rad/s]; None when the motion is lost."""
    if moment.motion is None:
        return None
    speed_mps, yaw_rate_radps = moment.motion.speed_mps, moment.motion.yaw_rate_radps
    lanes = [estimate.lane for estimate in moment.estimates if estimate.lane is not None]
    return min(
        WORST_RADPS,
        max((abs(yaw_rate_radps - speed_mps * lane.curvature_1pm) for lane in lanes), default=0.0),
    )
