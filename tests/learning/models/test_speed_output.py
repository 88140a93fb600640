"""The second output of a driving network: the speed of the driver, learned where it was recorded."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from learning.models.catalogue import build  # noqa: E402
from learning.models.parts.heads import HEADS  # noqa: E402
from learning.models.parts.network import ExportedNetwork, SpeedOutput  # noqa: E402
from learning.training.export import export  # noqa: E402
from learning.training.frames import Frames  # noqa: E402
from learning.training.recipe import load_recipe  # noqa: E402
from learning.training.run import prepare  # noqa: E402
from perception.net.driver import DriverNetwork  # noqa: E402
from trepid.config import InputError  # noqa: E402

UNKNOWN = float("nan")
METADATA = {
    "kind": "steering",
    "model": "steer",
    "parameters": 1,
    "height": 24,
    "width": 32,
    "interval_90": 2.0,
}


def frames(*speeds_mps: float) -> Frames:
    count, rng = len(speeds_mps), np.random.default_rng(0)
    images = rng.integers(0, 256, (count, 24, 32, 3)).astype(np.uint8)
    labels = np.linspace(-0.1, 0.2, count, dtype=np.float32)
    places = np.zeros(count, np.int32)
    return Frames(images, labels, places, places.astype(np.int64), ("a",), np.float32(speeds_mps))


def loss_and_gradient(speeds_mps: list[float], features: torch.Tensor) -> tuple[float, torch.Tensor]:
    torch.manual_seed(0)
    output = SpeedOutput(features.shape[1], 2.0, 0.5)
    loss = output.loss(output(features), torch.tensor(speeds_mps))
    loss.backward()
    return loss.item(), output.linear.weight.grad


def test_frames_without_a_recorded_speed_change_neither_the_loss_nor_its_gradient():
    features = torch.randn(5, 7, generator=torch.Generator().manual_seed(1))
    known = [1.0, 2.5, 3.0]
    loss, gradient = loss_and_gradient([1.0, UNKNOWN, 2.5, UNKNOWN, 3.0], features)
    expected, slope = loss_and_gradient(known, features[[0, 2, 4]])
    assert loss == pytest.approx(expected) and torch.allclose(gradient, slope)
    at_zero, _ = loss_and_gradient([1.0, 0.0, 2.5, 0.0, 3.0], features)
    assert abs(at_zero - loss) > 0.1, "an absent speed is not a speed of 0"


def test_a_batch_without_any_speed_has_no_loss_and_a_finite_gradient():
    loss, gradient = loss_and_gradient([UNKNOWN] * 3, torch.ones(3, 7))
    assert loss == 0.0 and not gradient.any()


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("name", ["steer", "cnn-lstm"])
def test_the_speed_leaves_angle_and_deviation_of_every_head_as_they_are(name, head):
    torch.manual_seed(0)
    network = build(name, height=24, width=32, head=head).eval()
    inputs = [torch.from_numpy(frames(1.0, 2.0).images)]
    inputs += [] if network.memory is None else [torch.zeros(2, network.memory.state_size)]
    with torch.no_grad():
        before = ExportedNetwork(network)(*inputs)
        network.add_speed(2.0, 0.5)
        exported = ExportedNetwork(network)
        after = dict(zip(exported.names, exported(*inputs), strict=True))
    assert all(
        torch.equal(a, after[b]) for a, b in zip(before[:2], ("road_wheel_rad", "sigma_rad"), strict=True)
    )
    assert after["speed_mps"].shape == (2,) and list(after)[2] == "speed_mps"


def test_only_a_recipe_that_asks_for_it_adds_the_speed():
    for given, added in (({}, False), ({"speed": "true"}, True)):
        network = build("steer", height=24, width=32)
        prepare(network, load_recipe("steer", None, overrides=given), frames(1.0, 3.0), lock_rad=None)
        assert (network.speed is not None) == added


def test_mean_and_deviation_are_those_of_the_recorded_speeds():
    network = build("steer", height=24, width=32)
    recipe = load_recipe("steer", None, overrides={"speed": "true"})
    prepare(network, recipe, frames(1.0, UNKNOWN, 3.0), lock_rad=None)
    assert (network.speed.mean_mps.item(), network.speed.spread_mps.item()) == (2.0, 1.0)
    with pytest.raises(InputError, match="no training frame has a recorded speed"):
        prepare(network, recipe, frames(UNKNOWN, UNKNOWN), lock_rad=None)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of the ONNX export in torch
@pytest.mark.parametrize("name", ["steer", "cnn-lstm"])
def test_the_driver_proposes_the_speed_of_the_trained_network(name, tmp_path):
    seen, out = frames(1.0, 2.0, 3.0), tmp_path / "f.onnx"
    torch.manual_seed(0)
    network = build(name, height=24, width=32)
    prepare(network, load_recipe(name, None, overrides={"speed": "true"}), seen, lock_rad=None)
    export(network, out, train=seen, validation=seen, metadata={**METADATA, "speed": True})
    driver, exported = DriverNetwork(out), ExportedNetwork(network.eval())
    inputs = [torch.from_numpy(seen.images[:1])]
    inputs += [] if network.memory is None else [torch.zeros(1, network.memory.state_size)]
    with torch.no_grad():
        wanted = dict(zip(exported.names, exported(*inputs), strict=True))["speed_mps"].item()
    assert driver(seen.images[0], driver.initial_state).speed_mps == pytest.approx(max(wanted, 0.0), abs=1e-4)
