"""The world of a network: the distance of an image from those of training, in the graph itself."""

from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="the world needs the extra: pip install -e '.[train]'")

from learning.unlike import NEIGHBOUR, attach  # noqa: E402
from perception.net.steer_net import Network  # noqa: E402
from trepid.config import ROOT  # noqa: E402
from trepid.types import Image  # noqa: E402

SHIPPED = ROOT / "perception" / "weights" / "steer_net.onnx"


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "steer_net.onnx"
    path.write_bytes(SHIPPED.read_bytes())
    return path


def pictures(count: int, seed: int) -> Image:
    """Random stripes in random light."""
    rng = np.random.default_rng(seed)
    rows = rng.integers(0, 256, (count, 1, 200, 3)) * rng.uniform(0.2, 1.0, (count, 1, 1, 1))
    noise = rng.integers(0, 40, (count, 66, 200, 3))
    return np.clip(rows + noise, 0, 255).astype(np.uint8)


def test_an_image_seen_often_enough_in_training_has_no_distance_and_another_one_has(weights: Path) -> None:
    known, other = pictures(1, 0), pictures(1, 1)
    attach(weights, np.repeat(known, NEIGHBOUR, axis=0))
    network = Network(weights)
    assert float(network(known).unlike[0]) == pytest.approx(0.0, abs=4e-3)  # eight bits a feature
    assert float(network(other).unlike[0]) > 0.01


def test_another_world_changes_no_lane_and_replaces_the_world_before(weights: Path) -> None:
    images, before = pictures(4, 2), Network(weights)(pictures(4, 2))
    attach(weights, pictures(8, 3))
    attach(weights, np.repeat(images, NEIGHBOUR, axis=0))
    after = Network(weights)(images)
    for one, other in zip(before[:3], after[:3], strict=True):
        assert np.array_equal(one, other)
    assert after.unlike == pytest.approx(np.zeros(4), abs=4e-3)
    assert weights.stat().st_size < SHIPPED.stat().st_size


def test_more_training_images_never_raise_the_distance(weights: Path) -> None:
    images, training = pictures(5, 4), pictures(40, 5)
    attach(weights, training[:10])
    few = Network(weights)(images).unlike
    attach(weights, training)
    assert (Network(weights)(images).unlike <= few + 4e-3).all()
