"""The lane beside ours is evidence of ours: lanes of one road run side by side and are about equally wide.

A marking filter that finds two good lines may have found those of the next lane, and says with confidence that the
car is a lane's width away from the middle. If the path so far has the car in its lane, that is not where the car
is. Moved over by whole lane widths, what was measured becomes a second view of our lane, of less confidence than
if its own lines were seen.
"""

from supervisor.inputs.validated import ValidatedEstimate

SHARE = 0.7  # of its confidence: lanes of one road differ in width by a few decimetres (RAA: 3.25 to 3.75 m)


def in_own_lane(s: ValidatedEstimate, offset_m: float | None) -> ValidatedEstimate:
    """``s``, moved over to the lane in which the car is, where it shows another one.

    ``offset_m`` is where the path so far has the car; None at the beginning: a driver hands over in a lane.
    """
    lane, width_m = s.lane, s.width_m
    if lane is None or width_m is None or not s.marked or s.width_error_m != 0.0 or s.confidence is None:
        return s
    lanes_over = round(lane.offset_m / width_m)
    if lanes_over == 0 or abs(offset_m or 0.0) > width_m / 2:
        return s
    own = lane._replace(offset_m=lane.offset_m - lanes_over * width_m)
    return s._replace(lane=own, confidence=SHARE * s.confidence)
