"""Masks of a segmentation network: probabilities, in the pixels of the whole image."""

from pathlib import Path

import numpy as np
import pytest
from segment_rig import HEIGHT, WIDTH, about, segmenter, write_network

from perception.segments.network import Segmenter
from trepid.config import InputError

GREY, GREEN, WHITE = (105, 105, 105), (60, 120, 80), (225, 225, 225)


def striped_road(rows: int, columns: int) -> np.ndarray:
    """Grass, and from the middle of the height on a road with a white line in its middle."""
    image = np.full((rows, columns, 3), GREEN, np.uint8)
    image[rows // 2 :] = GREY
    image[rows // 2 :, columns // 2 - columns // 40 : columns // 2 + columns // 40] = WHITE
    return image


@pytest.mark.parametrize("size", [(192, 320), (720, 1280), (480, 640), (375, 1242), (120, 160), (224, 224)])
def test_masks_keep_the_proportions_of_an_image_of_any_size(size: tuple[int, int], tmp_path: Path) -> None:
    masks = segmenter(tmp_path)(striped_road(*size))
    rows = round(size[0] * WIDTH / size[1])
    assert masks.lines.shape == masks.area.shape == (rows, WIDTH)
    painted = np.flatnonzero(masks.lines[-rows // 4] > 0.5)
    assert painted.mean() == pytest.approx(WIDTH / 2, abs=1.5)
    assert np.count_nonzero(masks.area[:, 10] > 0.5) == pytest.approx(rows / 2, abs=1.5)


def test_rows_above_the_reach_of_the_network_show_nothing(tmp_path: Path) -> None:
    masks = segmenter(tmp_path)(np.full((WIDTH, WIDTH, 3), GREY, np.uint8))
    assert (masks.area[: WIDTH - HEIGHT] == 0).all() and (masks.area[WIDTH - HEIGHT :] > 0.5).all()


def test_the_mirrored_image_has_the_mirrored_masks(tmp_path: Path) -> None:
    network, image = segmenter(tmp_path), striped_road(360, 640)
    image[200:, :100] = GREEN
    seen, mirrored = network(image), network(image[:, ::-1])
    for mask, other in zip(seen, mirrored, strict=True):
        np.testing.assert_allclose(mask, other[:, ::-1], atol=1e-6)


def test_logits_become_probabilities_by_softmax(tmp_path: Path) -> None:
    image = np.full((HEIGHT, WIDTH, 3), (0, 0, 178), np.uint8)  # BGR
    expected = 1 / (1 + np.exp(-60 * (178 / 255 - 0.75)))
    np.testing.assert_allclose(segmenter(tmp_path)(image).lines, expected, rtol=1e-4)


def test_the_order_and_the_scale_of_colours_follow_the_description(tmp_path: Path) -> None:
    blue, taken = np.full((HEIGHT, WIDTH, 3), (255, 0, 0), np.uint8), {"name": "x", "width": WIDTH}
    rgb = segmenter(tmp_path)(blue)
    bgr = segmenter(tmp_path, input=taken | {"height": HEIGHT, "colours": "bgr"})(blue)
    dark = segmenter(
        tmp_path, input=taken | {"height": HEIGHT, "colours": "bgr", "deviation": [4.0, 4.0, 4.0]}
    )(blue)
    assert rgb.lines.max() < 0.01 and bgr.lines.min() > 0.99 and dark.lines.max() < 0.01


def test_a_road_darker_than_those_of_the_training_is_brightened_and_a_lighter_one_is_not(
    tmp_path: Path,
) -> None:
    taken = {"name": "x", "width": WIDTH, "height": HEIGHT}
    plain = segmenter(tmp_path)
    knows_light_roads = segmenter(tmp_path, input=taken | {"least_grey": 100.0})
    day = striped_road(360, 640)
    dusk = day // 3
    assert (plain(dusk).lines[120] < 0.5).all() and (plain(day).lines[120] > 0.5).any()
    assert ((knows_light_roads(dusk).lines > 0.5) == (plain(day).lines > 0.5)).all()
    assert (knows_light_roads(day).lines == plain(day).lines).all()


def test_a_mask_that_a_network_does_not_give_is_absent(tmp_path: Path) -> None:
    assert segmenter(tmp_path, area=None)(striped_road(192, 320)).area is None


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"lines": {"output": "line", "channels": [1]}}, "has no output 'line'; it has lines, area"),
        (
            {"input": {"name": "image", "width": WIDTH, "height": HEIGHT}},
            "takes x; its description says image",
        ),
        ({"input": {"name": "x", "width": 160, "height": 96}}, "fails on a grey picture: .*dimensions"),
        (
            {"area": {"output": "area", "channels": [2]}},
            r"fails on a grey picture: output 'area' has the shape",
        ),
    ],
)
def test_a_network_that_is_not_the_described_one_is_refused(
    changes: dict[str, object], problem: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=f"colours.onnx: {problem}"):
        segmenter(tmp_path, **changes)


def test_a_network_without_finite_numbers_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="not finite"):
        Segmenter(write_network(tmp_path / "broken.onnx", bias=float("nan")), about())


def test_a_description_has_to_name_a_mask() -> None:
    with pytest.raises(ValueError, match="expected `lines`, `area` or both"):
        about(lines=None, area=None)
