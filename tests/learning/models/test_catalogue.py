"""Claims about the networks: their sizes, their outputs, their memories."""

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="networks need the extra: pip install -e '.[train]'")

from learning.models.catalogue import MODELS, build, model  # noqa: E402
from learning.models.efficientnet import EfficientNetLite0  # noqa: E402
from learning.models.imagenet import (  # noqa: E402
    VGG,
    VGG16,
    VGG19,
    InceptionV3,
)
from learning.models.parts.heads import BINS, HEADS, Categorical  # noqa: E402
from learning.models.parts.memory import LSTM, SimpleRNN  # noqa: E402
from learning.models.parts.motion import Shift, Standardisation  # noqa: E402
from learning.models.parts.network import ExportedNetwork, Size  # noqa: E402
from learning.models.parts.view import InputView  # noqa: E402
from learning.training.start import load_trunk  # noqa: E402
from trepid.config import InputError  # noqa: E402

SMALL = {
    "steer": (24, 32),
    "steer-motion": (24, 32),
    "steer-lstm": (24, 32),
    "cnn-lstm": (32, 40),
    "jain": (8, 16),
    "pilotnet": (100, 100),
    "donkey-linear": (64, 64),
}


def weights_of(module: torch.nn.Module) -> int:
    return sum(p.numel() for p in module.parameters())


def frames(count: int, height: int, width: int, seed: int = 0) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).integers(0, 256, (count, height, width, 3), np.uint8))


@pytest.mark.parametrize("name", MODELS)
def test_the_catalogue_states_the_number_of_weights(name):
    with torch.device("meta"):
        assert build(name).parameters_count == MODELS[name].parameters


def test_the_networks_of_deep_steer_have_the_printed_numbers_of_weights():
    with torch.device("meta"):
        trunk, top, printed = InceptionV3(), 2_098_176, 21_802_784
        channels = sum(m.num_features for m in trunk.modules() if isinstance(m, torch.nn.BatchNorm2d))
        assert weights_of(trunk) + channels == printed  # Keras counts two statistics and no gain
        assert MODELS["inception-v3"].parameters + channels == printed + top + 1_025 == 23_901_985
        assert MODELS["inception-rnn"].parameters + channels == 24_048_673
        assert weights_of(SimpleRNN(1024, 128)) == 147_584
        assert (weights_of(VGG(VGG16)), weights_of(VGG(VGG19))) == (14_714_688, 20_024_384)
        assert weights_of(EfficientNetLite0()) == 3_371_008


def test_a_frame_of_240_x_320_leaves_inception_as_6_x_8_x_2048():
    with torch.device("meta"):
        assert InceptionV3()(torch.zeros(1, 3, 240, 320)).shape == (1, 2048, 6, 8)


def test_the_networks_for_a_small_computer_have_at_most_300_000_weights():
    assert all(MODELS[name].parameters <= 300_000 for name in ("steer", "steer-motion", "steer-lstm"))


@pytest.mark.parametrize("head", HEADS)
def test_every_head_gives_a_finite_angle_and_a_positive_deviation(head):
    network = build("steer", height=24, width=32, head=head).eval()
    angle, sigma = ExportedNetwork(network)(frames(5, 24, 32))
    assert angle.shape == sigma.shape == (5,)
    assert torch.isfinite(angle).all() and torch.isfinite(sigma).all() and (sigma > 0).all()


@pytest.mark.parametrize("name", SMALL)
def test_a_network_takes_frames_of_another_size(name):
    height, width = SMALL[name]
    network = build(name, height=height, width=width).eval()
    images = frames(2, height, width)
    raw = network(images) if network.memory is None else network(images[None])[0]
    assert raw.shape == (1 if isinstance(network.memory, Shift) else 2, network.head.size)


def test_frames_that_are_too_small_are_refused_in_one_line():
    with pytest.raises(InputError, match="frames of 32x24 px are too small"):
        build("pilotnet", height=24, width=32)


def test_an_unknown_network_is_answered_with_a_similar_name():
    with pytest.raises(InputError, match="did you mean 'pilotnet'"):
        model("pilotnett")


def test_the_memory_of_a_sequence_depends_on_the_frames_before():
    torch.manual_seed(0)
    network = build("cnn-lstm", height=32, width=40).eval()
    one, other = frames(4, 32, 40, 1), frames(4, 32, 40, 2)
    other[-1] = one[-1]
    with torch.no_grad():
        assert abs(float(network(one[None])[0, -1] - network(other[None])[0, -1])) > 1e-6


@pytest.mark.parametrize("memory", [SimpleRNN(6, 4), LSTM(6, 4)])
def test_steps_from_a_state_equal_the_sequence(memory):
    features = torch.randn(3, 5, 6, generator=torch.Generator().manual_seed(0))
    state = torch.zeros(3, memory.state_size)
    for t, wanted in enumerate(memory(features).unbind(1)):
        output, state = memory.step(features[:, t], state)
        assert torch.allclose(output, wanted)


def test_the_shift_of_the_view_is_measured_to_a_part_of_a_column_and_is_none_at_the_start():
    width, height, places_px = 80, 12, (0.0, 1.3, 4.0, 3.2)
    random = np.random.default_rng(0).normal(size=(height, 40 * (width + 40)))
    kernel = np.hanning(240)
    course = np.stack([np.convolve(row, kernel, mode="same") for row in random])
    at = 40 * (np.arange(width) + 20)
    memory = Shift((height, width), 2, 8)
    state, found = torch.zeros(1, memory.state_size), []
    for place in places_px:
        row = course[:, np.round(at - 40 * place).astype(int)].astype(np.float32)
        output, state = memory.step(torch.from_numpy(np.tile(row, (1, 3, 1, 1))), state)
        found.append((output[0, -memory.moved : -2] * 0.125 * width).numpy())
    assert found[0] == pytest.approx([0.0, 0.0], abs=0.02)
    assert found[1] == pytest.approx([1.3, 0.0], abs=0.1)
    assert found[3] == pytest.approx([-0.8, 2.7], abs=0.1)


@pytest.mark.parametrize("name", ["steer-motion", "steer-lstm", "cnn-lstm"])
def test_frames_one_by_one_give_the_angle_of_their_sequence(name):
    network = build(name, height=32, width=40).eval()
    images, state = frames(5, 32, 40), torch.zeros(1, network.memory.state_size)
    with torch.no_grad():
        for image in images:
            angle, _, state = ExportedNetwork(network)(image[None], state)
        wanted, _ = network.angle(network(images[None]))
    assert wanted.shape == (1, 1 if network.memory.last_alone else 5)
    assert torch.allclose(angle, wanted[0, -1:], atol=1e-6)


def test_a_long_short_term_memory_depends_on_the_last_frames_of_its_window_alone():
    memory = LSTM(6, 4)
    memory.remember(3)
    features = torch.randn(2, 40, 6, generator=torch.Generator().manual_seed(0))
    state = torch.zeros(2, memory.state_size)
    for t, seen in enumerate(features.unbind(1)):
        output, state = memory.step(seen, state)
        wanted = memory(features[:, max(t - 2, 0) : t + 1])[:, -1]
        assert torch.allclose(output, wanted, atol=1e-6)


def test_the_network_as_printed_has_no_memory():
    with torch.device("meta"):
        assert build("inception-rnn-as-printed").memory is None and build("inception-rnn").memory is not None


def test_a_bin_of_the_categorical_head_is_the_nearest_angle():
    head = Categorical()
    raw = torch.full((BINS, BINS), -9.0).fill_diagonal_(9.0)
    angles, _ = head.angle(raw)
    assert torch.allclose(angles, torch.linspace(-1, 1, BINS), atol=1e-6)
    losses = torch.stack(
        [head.losses(raw, torch.full((BINS,), a), loss="mse", beta=0.5) for a in angles.tolist()]
    )
    assert (losses.argmin(1) == torch.arange(BINS)).all()


@pytest.mark.parametrize("name, squared", [("gaussian", True), ("laplace", False)])
def test_the_likelihood_is_greatest_where_the_scale_is_the_error(name, squared):
    head, error = HEADS[name](), 0.3
    scales = torch.linspace(0.1, 1.0, 181)
    raw = torch.stack([torch.zeros_like(scales), scales.log()], dim=1)
    losses = head.losses(raw, torch.full_like(scales, error), loss="mse", beta=0.0)
    assert float(scales[losses.argmin()]) == pytest.approx(error, abs=0.006)


def test_the_planes_y_u_v_are_those_of_opencv():
    image = np.random.default_rng(0).integers(0, 256, (1, 24, 32, 3)).astype(np.uint8)
    found = InputView(colour="yuv")(torch.from_numpy(image))[0].permute(1, 2, 0).numpy() * 255
    wanted = cv2.cvtColor(image[0], cv2.COLOR_BGR2YUV).astype(float)
    assert np.abs(np.clip(found, 0, 255) - wanted).max() <= 2


def test_a_matched_histogram_does_not_depend_on_the_exposure():
    view = InputView(histogram="match")
    image = np.random.default_rng(0).integers(40, 120, (1, 24, 32, 1)).repeat(3, axis=3).astype(np.uint8)
    view.match(np.bincount(image[..., 0].ravel(), minlength=256))
    plain, doubled = view(torch.from_numpy(image)), view(torch.from_numpy(image * 2))
    assert float((plain - doubled).abs().max()) <= 2 / 255
    assert float((plain - InputView()(torch.from_numpy(image))).abs().max()) <= 2 / 255


def test_a_saturated_half_of_a_frame_gets_the_middle_of_what_it_was():
    view = InputView(histogram="match")
    image = np.random.default_rng(0).integers(0, 200, (1, 64, 64, 1)).repeat(3, axis=3).astype(np.uint8)
    view.match(np.bincount(image[..., 0].ravel(), minlength=256))
    saturated = np.where(image >= 100, 255, image).astype(np.uint8)
    plain, found = (view(torch.from_numpy(one)) * 255 for one in (image, saturated))
    bright = torch.from_numpy(image >= 100).permute(0, 3, 1, 2)
    assert float((found - plain)[~bright].abs().max()) <= 1
    assert float(found[bright].min()) == float(found[bright].max()) == pytest.approx(149.5, abs=2)


def test_weights_of_a_trunk_come_from_a_file_of_the_public_layout(tmp_path):
    torch.manual_seed(0)
    source, target = EfficientNetLite0(), EfficientNetLite0()
    classifier = {"_fc.weight": torch.zeros(1000, 1280)}
    torch.save({**source.state_dict(), **classifier}, tmp_path / "w.pth")
    load_trunk(target, tmp_path / "w.pth")
    assert all(torch.equal(a, b) for a, b in zip(source.parameters(), target.parameters(), strict=True))


def test_weights_of_another_network_or_a_broken_file_are_refused(tmp_path):
    torch.save({"features.0.weight": torch.zeros(1)}, tmp_path / "w.pth")
    with pytest.raises(InputError, match=r"w\.pth: no weights '_conv_stem\.weight'"):
        load_trunk(EfficientNetLite0(), tmp_path / "w.pth")
    (tmp_path / "half.pth").write_bytes((tmp_path / "w.pth").read_bytes()[:300])
    with pytest.raises(InputError, match=r"half\.pth: no file of weights"):
        load_trunk(EfficientNetLite0(), tmp_path / "half.pth")


def test_the_size_of_a_network_is_rows_and_columns():
    assert build("steer", height=24, width=32).size == Size(24, 32)


def test_the_scale_of_the_shifts_is_that_of_the_training_and_not_of_a_batch():
    scale, rng = Standardisation(2).train(), torch.Generator().manual_seed(0)

    def batch() -> torch.Tensor:
        return torch.randn(16, 2, generator=rng) * torch.tensor([2.0, 0.1]) + torch.tensor([0.0, 1.0])

    for _ in range(400):
        scale(batch())
    one = torch.tensor([[2.0, 1.1]])
    beside_others = [scale(torch.cat([one, batch()]))[0] for _ in range(20)]
    assert torch.stack(beside_others).std(dim=0).max() < 0.01
    assert scale.eval()(one)[0].tolist() == pytest.approx([1.0, 1.0], abs=0.1)
