"""Changes of the pixels of an image."""

import numpy as np
import pytest

from learning.pixels import SHIFTS


@pytest.mark.parametrize("name", SHIFTS)
def test_a_shift_changes_the_image_and_keeps_its_size(name: str) -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(40, 200, (60, 80, 3)).astype(np.uint8)
    before = image.copy()
    changed = SHIFTS[name](image, rng)
    assert changed.shape == image.shape and changed.dtype == np.uint8
    assert np.abs(changed.astype(float) - image).mean() > 1 and (image == before).all()
