import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.detection.surface import road_likelihood, surface_bins

ASPHALT, GRASS = (
    (0.16, 0.17, 0.17),
    (0.06, 0.17, 0.13),
)  # blue, green, red: shares of the light that they reflect


def grey_levels(shares: tuple[float, float, float], light: float) -> np.ndarray:
    """The sRGB pixel of a surface in so much of full light."""
    linear = light * np.array(shares)
    return np.round(255 * (1.055 * linear ** (1 / 2.4) - 0.055)).astype(np.uint8)


@pytest.mark.parametrize("light", [0.15, 0.3, 0.6])
def test_the_chroma_of_grass_is_about_the_same_in_the_shade(light):
    pixels = np.array([[grey_levels(GRASS, 1.0), grey_levels(GRASS, light)]])
    lit, shaded = (divmod(int(number), 32) for number in surface_bins(pixels).chroma[0])
    assert np.abs(np.subtract(lit, shaded)).max() <= 1


def test_grass_in_the_shade_looks_less_like_a_road_than_a_road_in_the_shade():
    left, right = np.arange(8) < 4, np.arange(8) >= 4
    lit = np.where(left[:, None], grey_levels(ASPHALT, 1.0), grey_levels(GRASS, 1.0))
    dark = np.where(left[:, None], grey_levels(ASPHALT, 0.2), grey_levels(GRASS, 0.2))
    bins = surface_bins(np.array([lit] * 20 + [dark]))
    road, rest = (np.repeat([np.append(np.repeat(True, 20), False)], 8, 0).T & half for half in (left, right))
    ratio = road_likelihood(bins, road, rest, lane_cv_settings().edges.surface)[-1]
    assert ratio[left].min() > 1.0 and ratio[right].max() < -1.0
