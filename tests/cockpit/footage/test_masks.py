"""`trepid estimate --estimator segments --annotate` draws the masks of its network under the lane."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from segment_rig import write_network_of_car

from cockpit.footage.masks import AREA, LINES, with_masks
from perception.segments.network import Masks
from sim_harness.footage.estimate_cli import estimate
from trepid.config import CONFIG_DIR


@pytest.mark.parametrize("probability", [0.0, 0.5, 1.0])
def test_a_mask_is_mixed_into_the_image_as_far_as_it_is_probable(probability: float) -> None:
    image, mask = np.full((48, 64, 3), 100, np.uint8), np.full((24, 32), probability, np.float32)
    for masks, (colour, share) in ((Masks(None, mask), AREA), (Masks(mask, None), LINES)):
        expected = 100 + probability * share * (np.array(colour) - 100)
        np.testing.assert_allclose(with_masks(image, masks)[20, 30], expected, atol=1.0)
    assert (image == 100).all()


def test_annotated_images_show_area_green_and_lines_red_beyond_the_lane(
    picture: np.ndarray, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_network_of_car(tmp_path / "car")
    monkeypatch.setenv("TREPID_CAR", str(tmp_path / "car"))
    cv2.imwrite(str(tmp_path / "road.png"), picture)
    drawn = {}
    for name in ("segments", "cv"):
        out = tmp_path / f"{name}.png"
        estimate([tmp_path / "road.png"], estimator=name, camera=CONFIG_DIR / "camera.yaml", annotate=out)
        drawn[name] = cv2.imread(str(out)).astype(int)
    changed = drawn["segments"] - drawn["cv"]
    seen = cv2.resize(picture, changed.shape[1::-1]).astype(int)
    ground = np.arange(len(seen))[:, None] > 220  # below the texts and the horizon
    grass = ground & (seen[..., 1] > seen[..., 2] + 20)
    asphalt, paint = (ground & (abs(seen.min(axis=2) - grey) < 15) & ~grass for grey in (105, 220))
    greener = changed[..., 1] - changed[..., 2]
    assert np.median(greener[asphalt]) > 40 and np.median(greener[paint]) < -40
    assert np.abs(changed[grass]).mean() < 3
