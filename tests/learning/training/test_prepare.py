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
