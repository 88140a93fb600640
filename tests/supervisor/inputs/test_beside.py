"""The neighbouring lane as an estimate of the own lane."""

import math

import pytest

from supervisor.inputs.validation import SHARE, ValidatedEstimate, in_own_lane
from trepid.clothoid import Lane

WIDTH_M = 3.5


def neighbour(offset_m: float, *, marked: bool = True, width_error_m: float = 0.0) -> ValidatedEstimate:
    lane = Lane(offset_m, 0.02, 0.01, 0.0)
    return ValidatedEstimate(
        "cv", 0.04, 1.0, False, 0.9, lane, 8.0, width_error_m, True, width_m=WIDTH_M, marked=marked
    )


@pytest.mark.parametrize("lanes_over", [-2, -1, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_a_neighbouring_lane_is_shifted_by_whole_widths_and_gets_lower_confidence(
    lanes_over: int, side: int
) -> None:
    found = in_own_lane(neighbour(side * (0.3 + lanes_over * WIDTH_M)), side * 0.3)
    assert found.lane is not None and found.confidence is not None
    assert math.isclose(found.lane.offset_m, side * 0.3, abs_tol=1e-9)
    assert found.lane[1:4] == (0.02, 0.01, 0.0)
    assert math.isclose(found.confidence, SHARE * 0.9)


def test_at_the_beginning_the_car_is_taken_to_be_in_its_lane() -> None:
    found = in_own_lane(neighbour(-3.5), None)
    assert found.lane is not None and abs(found.lane.offset_m) < 1e-9


@pytest.mark.parametrize(
    ("validated", "offset_m"),
    [
        (neighbour(1.7), 0.0),  # in its lane, if barely
        (neighbour(2.2), 1.8),  # the path agrees: the car has left its lane
        (neighbour(3.5, marked=False), 0.0),  # the edges of a road are no neighbouring lane
        (neighbour(3.5, width_error_m=0.4), 0.0),  # a strip of another width is no lane
    ],
)
def test_any_other_estimate_stays_unchanged(validated: ValidatedEstimate, offset_m: float) -> None:
    assert in_own_lane(validated, offset_m) is validated
