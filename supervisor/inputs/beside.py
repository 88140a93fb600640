"""Use of a neighbouring lane as evidence of the ego lane: lanes of a road are parallel and about equally wide.

A marking filter may find the two lines of the next lane and report with confidence that the car is a lane's width
away from the centre. If the car is in its lane by the path so far, the measured lane is shifted by whole lane
widths and used as an estimate of the ego lane with reduced confidence.
"""

from supervisor.inputs.validated import ValidatedEstimate

SHARE = 0.7  # of its confidence: lanes of one road differ in width by a few decimetres (RAA: 3.25 to 3.75 m)


def in_own_lane(s: ValidatedEstimate, offset_m: float | None) -> ValidatedEstimate:
    """``s``, shifted to the lane of the car where it measures another one.

    ``offset_m`` is the offset of the car on the path so far; None at the beginning, in a lane by assumption.
    """
    lane, width_m = s.lane, s.width_m
    if lane is None or width_m is None or not s.marked or s.width_error_m != 0.0 or s.confidence is None:
        return s
    lanes_over = round(lane.offset_m / width_m)
    if lanes_over == 0 or abs(offset_m or 0.0) > width_m / 2:
        return s
    own = lane._replace(offset_m=lane.offset_m - lanes_over * width_m)
    return s._replace(lane=own, confidence=SHARE * s.confidence)
