"""TwinLiteNet as an ONNX file: the masks of the torch network, from a checkpoint with the names of its authors."""

import io
from pathlib import Path

import numpy as np
import onnx
import pytest
import torch

from learning.twinlitenet import PREFIX, TwinLiteNet, to_onnx
from perception.segments.network import Segmenter
from perception.segments.settings import network_description
from trepid.config import InputError

ABOUT = network_description("twinlitenet")


def checkpoint(network: TwinLiteNet) -> bytes:
    """The weights of ``network`` as its authors save them."""
    written = io.BytesIO()
    torch.save({PREFIX + name: value for name, value in network.state_dict().items()}, written)
    return written.getvalue()


def random_network() -> TwinLiteNet:
    torch.manual_seed(5)
    network = TwinLiteNet()
    with torch.no_grad():
        for name, value in network.state_dict().items():
            if name.endswith(("running_var", "gamma")):
                value.copy_(torch.rand_like(value) + 0.5)
    return network.eval()


def test_it_has_the_number_of_weights_of_the_paper() -> None:
    assert sum(one.numel() for one in TwinLiteNet().parameters()) == pytest.approx(0.44e6, rel=0.01)


def test_the_file_gives_the_masks_of_the_network(tmp_path: Path) -> None:
    network, path = random_network(), tmp_path / "twin.onnx"
    path.write_bytes(to_onnx(checkpoint(network), ABOUT, "random"))
    image = np.random.default_rng(3).integers(0, 256, (192, 320, 3), np.uint8)
    masks = Segmenter(path, ABOUT)(image)
    with torch.no_grad():
        picture = torch.from_numpy(image[:, :, ::-1].transpose(2, 0, 1).copy()).float()[None] / 255
        area, lines = (torch.softmax(one, 1)[0, 1].numpy() for one in network(picture))
    np.testing.assert_allclose(masks.area, area, atol=1e-4)
    np.testing.assert_allclose(masks.lines, lines, atol=1e-4)


def test_the_file_has_no_denormal_weights() -> None:
    network = random_network()
    with torch.no_grad():
        network.encoder.level1.conv.weight[0] = 1e-40
    model = onnx.load_model_from_string(to_onnx(checkpoint(network), ABOUT, "random"))
    for weights in model.graph.initializer:
        values = np.abs(onnx.numpy_helper.to_array(weights).astype(np.float64))
        assert ((values == 0) | (values > 1.2e-38)).all()


@pytest.mark.parametrize("content", [b"", b"no checkpoint", checkpoint(random_network())[:5000]])
def test_another_file_is_one_line(content: bytes) -> None:
    with pytest.raises(InputError, match=r"^best\.pth: no checkpoint of TwinLiteNet: [^\n]*$"):
        to_onnx(content, ABOUT, "best.pth")


def test_the_weights_of_another_network_are_one_line() -> None:
    written = io.BytesIO()
    torch.save(torch.nn.Linear(2, 2).state_dict(), written)
    with pytest.raises(InputError, match=r"^best\.pth: no checkpoint of TwinLiteNet: [^\n]*$"):
        to_onnx(written.getvalue(), ABOUT, "best.pth")
