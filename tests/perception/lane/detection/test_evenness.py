import numpy as np
import pytest

from perception.lane.detection.evenness import columns, unevenness

LEFT = tuple((40.0 + 1.0 * (230 - y), float(y)) for y in range(230, 130, -10))
RIGHT = tuple((280.0 - 1.0 * (230 - y), float(y)) for y in range(230, 130, -10))
GREY = 110


def plain(seed=0):
    noise = np.random.default_rng(seed).normal(0, 3, (240, 320, 3))
    return np.clip(GREY + noise, 0, 255).astype(np.uint8)


def with_patch(image, colour, roughness=0.0):
    """``image`` with another surface on the left part of the far half of the lane."""
    other = image[:185, :170].astype(float) * 0 + colour
    other += np.random.default_rng(1).normal(0, 1, other.shape[:2])[..., None] * (3 + roughness)
    image[:185, :170] = np.clip(other, 0, 255).astype(np.uint8)
    return image


def test_a_lane_on_one_surface_is_even():
    assert unevenness(plain(), LEFT, RIGHT) == pytest.approx(0.0, abs=0.1)


def test_a_lane_that_covers_another_colour_is_uneven():
    assert unevenness(with_patch(plain(), (60, 140, 60)), LEFT, RIGHT) > 0.3


def test_a_lane_that_covers_a_rougher_surface_is_uneven():
    assert unevenness(with_patch(plain(), (GREY,) * 3, roughness=40.0), LEFT, RIGHT) > 0.5


def test_half_the_light_changes_nothing():
    one, other = plain(), (with_patch(plain(), (60, 140, 60)) // 2).astype(np.uint8)
    assert unevenness((one // 2).astype(np.uint8), LEFT, RIGHT) == pytest.approx(0.0, abs=0.15)
    assert unevenness(other, LEFT, RIGHT) > 0.25


@pytest.mark.parametrize(("left", "right"), [((), RIGHT), (LEFT, ()), (RIGHT, LEFT), (LEFT[:2], RIGHT[:2])])
def test_without_a_lane_in_the_image_nothing_is_known(left, right):
    assert unevenness(plain(), left, right) is None


def test_columns_lie_between_the_points_and_are_not_known_beyond():
    found = columns(((10.0, 100.0), (20.0, 50.0)), np.array([110.0, 75.0, 40.0]))
    assert np.isnan(found[[0, 2]]).all() and found[1] == pytest.approx(15.0)
