"""Frames become JPEG at full rate within a budget of bytes."""

from itertools import accumulate

import cv2
import numpy as np
import pytest

from trepid.images.jpeg import BEST, LEAST, JpegEncoder
from trepid.messages import Frame

RATE_HZ, SECONDS = 25, 12
NOISE = np.random.default_rng(0).integers(0, 255, (240, 320, 3), np.uint8)
ROAD = cv2.GaussianBlur(NOISE, (0, 0), 4)


def sizes(encoder: JpegEncoder, image: np.ndarray) -> list[int]:
    """Bytes of each frame of a drive; 0 for one that is left out."""
    taken = (encoder.step(Frame(t_s=5.0 + n / RATE_HZ, image=image)) for n in range(RATE_HZ * SECONDS))
    return [0 if jpeg is None else len(jpeg.jpeg) for jpeg in taken]


def test_within_the_budget_every_frame_has_the_best_quality() -> None:
    encoder = JpegEncoder(budget_kb_per_s=400.0)
    assert all(sizes(encoder, ROAD)) and encoder.quality == BEST


def test_the_quality_falls_until_the_full_rate_fits_the_budget() -> None:
    full = sum(sizes(JpegEncoder(budget_kb_per_s=1e6), NOISE)) / SECONDS
    encoder = JpegEncoder(budget_kb_per_s=0.6e-3 * full)
    found = sizes(encoder, NOISE)
    assert all(found[RATE_HZ:]) and LEAST < encoder.quality < BEST
    assert sum(found) / SECONDS <= 0.6 * full * (1 + 1 / SECONDS) + max(found)


@pytest.mark.parametrize("budget_kb_per_s", [20.0, 200.0, 700.0])
def test_no_stretch_of_time_takes_more_than_the_budget_and_one_second_of_it(budget_kb_per_s: float) -> None:
    found = sizes(JpegEncoder(budget_kb_per_s=budget_kb_per_s), NOISE)
    total = [0, *accumulate(found)]
    for first in range(0, len(found), 7):
        for last in range(first + 1, len(found) + 1, 11):
            allowed = 1e3 * budget_kb_per_s * ((last - first) / RATE_HZ + 1.0) + max(found)
            assert total[last] - total[first] <= allowed
    assert any(found[-RATE_HZ:]), "a small budget leaves frames out, but not all"


def test_a_small_image_again_has_the_best_quality_after_a_while() -> None:
    encoder = JpegEncoder(budget_kb_per_s=300.0)
    sizes(encoder, NOISE)
    assert encoder.quality < BEST
    for n in range(RATE_HZ * 5):
        encoder.step(Frame(t_s=100.0 + n / RATE_HZ, image=ROAD))
    assert encoder.quality == BEST
