"""Ants join what a weak stretch of an edge has parted, and nothing across even ground."""

import cv2
import numpy as np
import pytest
from technique_rig import VIEW

from perception.techniques.image.ants import canny_ants
from perception.techniques.image.edges import canny

THRESHOLDS = {"low": 100.0, "high": 150.0}


def weak_edge(least_share: float, half_rows: float) -> np.ndarray:
    """An upright edge of 120 grey levels that falls to a share of them in the middle."""
    rows = np.arange(60)[:, None]
    share = 1.0 - (1.0 - least_share) * np.exp(-(((rows - 30) / half_rows) ** 2))
    picture = 80 + 120 * share * (np.arange(80)[None] >= 40)
    return cv2.GaussianBlur(picture.astype(np.uint8), (0, 0), 1.0)


def pieces(response: np.ndarray) -> int:
    return cv2.connectedComponents((response > 0).astype(np.uint8), connectivity=8)[0] - 1


@pytest.mark.parametrize("least_share, half_rows", [(0.2, 6.0), (0.3, 9.0), (0.3, 6.0)])
def test_a_weak_stretch_of_an_edge_is_bridged(least_share, half_rows):
    picture = weak_edge(least_share, half_rows)
    parted = canny(picture, VIEW, low=140, high=160).response
    joined = canny_ants(picture, VIEW, low=140, high=160).response
    assert pieces(parted) == 2 and pieces(joined) == 1
    added = np.argwhere((joined > 0) & (parted == 0))
    assert (np.abs(added[:, 1] - 39.5) <= 2).all(), "the way is that of the edge"


def test_two_edges_with_even_ground_between_them_stay_apart():
    picture = np.full((60, 80), 80, np.uint8)
    picture[:24, 40:], picture[36:, 40:] = 200, 200
    picture[:24, 20:24] = picture[36:, 20:24] = 200
    picture = cv2.GaussianBlur(picture, (0, 0), 1.0)
    before, after = (find(picture, VIEW, **THRESHOLDS).response for find in (canny, canny_ants))
    assert pieces(after) == pieces(before)


def test_the_edges_of_canny_stay_and_the_same_picture_gives_the_same():
    picture = np.random.default_rng(3).integers(0, 255, (60, 80)).astype(np.uint8)
    picture = cv2.GaussianBlur(picture, (0, 0), 2.0) * 3
    found = canny_ants(picture, VIEW).response
    assert (found[canny(picture, VIEW).response > 0] > 0).all()
    assert np.array_equal(found, canny_ants(picture, VIEW).response)


def test_a_picture_without_an_edge_has_none():
    assert not canny_ants(np.full((60, 80), 90, np.uint8), VIEW).response.any()
