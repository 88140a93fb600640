"""What the recipe changes in an untrained network."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from learning.models.catalogue import build  # noqa: E402
from learning.training.frames import Frames  # noqa: E402
from learning.training.recipe import load_recipe  # noqa: E402
from learning.training.run import prepare  # noqa: E402

FRAMES = Frames(
    np.zeros((2, 60, 80, 3), np.uint8),
    np.float32([0.1, -0.1]),
    np.zeros(2, np.int32),
    np.zeros(2, np.int64),
    ("a",),
)


@pytest.mark.parametrize("given, expected", [({}, [0.3, 0.3]), ({"dropout": "0.05"}, [0.05, 0.05])])
def test_dropout_is_that_of_the_recipe_or_else_that_of_the_network(given, expected):
    network = build("steer")
    prepare(network, load_recipe("steer", None, overrides=given), FRAMES, lock_rad=None)
    assert [layer.p for layer in network.modules() if isinstance(layer, torch.nn.Dropout)] == expected


@pytest.mark.parametrize("initialisation", ["glorot", "he"])
@pytest.mark.parametrize("name", ["cnn-lstm", "steer-lstm"])
def test_a_memory_keeps_its_first_weights(name, initialisation):
    network = build(name, height=48, width=64)
    before = {key: one.clone() for key, one in network.memory.state_dict().items()}
    prepare(
        network, load_recipe(name, None, overrides={"initialisation": initialisation}), FRAMES, lock_rad=None
    )
    assert all(torch.equal(before[key], one) for key, one in network.memory.state_dict().items())


def test_the_reference_histogram_is_that_of_the_part_that_the_network_reads():
    network, rng = build("pilotnet"), np.random.default_rng(0)
    images = rng.integers(40, 60, (2, *network.size, 3)).astype(np.uint8)
    images[:, : network.view.crop_px] = 255  # sky
    recipe = load_recipe("pilotnet", None, overrides={"histogram": "match"})
    prepare(network, recipe, Frames(images, *FRAMES[1:]), lock_rad=None)
    assert network.view.crop_px > 0 and network.view.reference[:-1].max() < 61
