"""TwinLiteNet, from the checkpoint of its authors to the ONNX file that the estimator ``segments`` runs.

The architecture is that of Che et al., TwinLiteNet (MAPR 2023, arXiv 2307.10705): an encoder of efficient spatial
pyramids (Mehta et al., ESPNet, ECCV 2018) with attention over places and channels (Fu et al., DANet, CVPR 2019),
and two decoders, for the drivable area and for lane lines. The names of the layers are those of the checkpoint.
"""

import io

import torch
from torch import Tensor, nn

from perception.net.session import line_of
from perception.segments.network import SegmentNetwork
from trepid.config import InputError

PREFIX = "module."  # of the names in the checkpoint
PYRAMIDS = (2, 3)  # of the second and the third level
DILATIONS = (2, 4, 8, 16)
EPS = 1e-3
OPSET = 17
LEAST = 1e-30


class Bare(nn.Module):
    """A convolution alone."""

    def __init__(self, inputs: int, outputs: int, size: int, *, stride: int = 1, dilation: int = 1) -> None:
        super().__init__()
        self.conv = nn.Conv2d(
            inputs, outputs, size, stride, size // 2 * dilation, dilation=dilation, bias=False
        )

    def forward(self, x: Tensor) -> Tensor:
        """The convolution of ``x``."""
        found: Tensor = self.conv(x)
        return found


class Active(nn.Module):
    """Normalisation and activation, after a layer if there is one."""

    def __init__(self, outputs: int) -> None:
        super().__init__()
        self.bn = nn.BatchNorm2d(outputs, eps=EPS)
        self.act = nn.PReLU(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """The activation of ``x``."""
        found: Tensor = self.act(self.bn(x))
        return found


class Convolution(Active):
    """A convolution, normalised and activated."""

    def __init__(self, inputs: int, outputs: int, size: int, stride: int = 1) -> None:
        super().__init__(outputs)
        self.conv = nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """The layer of ``x``."""
        return super().forward(self.conv(x))


class Enlargement(Active):
    """Twice the height and the width."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(outputs)
        self.deconv = nn.ConvTranspose2d(inputs, outputs, 2, stride=2, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """The layer of ``x``."""
        return super().forward(self.deconv(x))


class Pyramid(nn.Module):
    """Dilated convolutions of a reduced input, summed step by step and joined: a pyramid of fields of view."""

    def __init__(self, inputs: int, outputs: int, *, size: int, stride: int) -> None:
        super().__init__()
        branch = outputs // (len(DILATIONS) + 1)
        self.c1 = Bare(inputs, branch, size, stride=stride)
        self.d1 = Bare(branch, outputs - len(DILATIONS) * branch, 3)
        for dilation in DILATIONS:
            setattr(self, f"d{dilation}", Bare(branch, branch, 3, dilation=dilation))

    def join(self, x: Tensor) -> Tensor:
        """The branches side by side."""
        reduced = self.c1(x)
        parts, total = [self.d1(reduced)], None
        for dilation in DILATIONS:
            part = getattr(self, f"d{dilation}")(reduced)
            total = part if total is None else total + part
            parts.append(total)
        return torch.cat(parts, 1)


class Halving(Pyramid):
    """A pyramid of half the height and the width."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, size=3, stride=2)
        self.bn = nn.BatchNorm2d(outputs, eps=EPS)
        self.act = nn.PReLU(outputs)

    def forward(self, x: Tensor) -> Tensor:
        """The layer of ``x``."""
        found: Tensor = self.act(self.bn(self.join(x)))
        return found


class Residual(Pyramid):
    """A pyramid added to its input."""

    def __init__(self, channels: int) -> None:
        super().__init__(channels, channels, size=1, stride=1)
        self.bn = Active(channels)

    def forward(self, x: Tensor) -> Tensor:
        """The layer of ``x``."""
        found: Tensor = self.bn(x + self.join(x))
        return found


class PlaceAttention(nn.Module):
    """Every place sees all others, by the likeness of their features."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.query_conv = nn.Conv2d(channels, channels // 8, 1)
        self.key_conv = nn.Conv2d(channels, channels // 8, 1)
        self.value_conv = nn.Conv2d(channels, channels, 1)
        self.gamma = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        """``x`` and what its places see."""
        query, key, value = (
            layer(x).flatten(2) for layer in (self.query_conv, self.key_conv, self.value_conv)
        )
        weights = torch.softmax(torch.bmm(query.transpose(1, 2), key), dim=-1)
        return self.gamma * torch.bmm(value, weights.transpose(1, 2)).view_as(x) + x


class ChannelAttention(nn.Module):
    """Every channel sees all others, by their unlikeness."""

    def __init__(self) -> None:
        super().__init__()
        self.gamma = nn.Parameter(torch.zeros(1))

    def forward(self, x: Tensor) -> Tensor:
        """``x`` and what its channels see."""
        flat = x.flatten(2)
        alike = torch.bmm(flat, flat.transpose(1, 2))
        weights = torch.softmax(alike.amax(dim=-1, keepdim=True) - alike, dim=-1)
        return self.gamma * torch.bmm(weights, flat).view_as(x) + x


class Encoder(nn.Module):
    """Features of an eighth of the height and the width."""

    def __init__(self) -> None:
        super().__init__()
        second, third = PYRAMIDS
        self.level1 = Convolution(3, 16, 3, 2)
        self.b1 = Convolution(19, 19, 3)
        self.level2_0 = Halving(19, 64)
        self.level2 = nn.Sequential(*(Residual(64) for _ in range(second)))
        self.b2 = Convolution(131, 131, 3)
        self.level3_0 = Halving(131, 128)
        self.level3 = nn.Sequential(*(Residual(128) for _ in range(third)))
        self.b3 = Convolution(256, 32, 3)
        self.sa, self.sc = PlaceAttention(32), ChannelAttention()
        self.conv_sa, self.conv_sc = Convolution(32, 32, 3), Convolution(32, 32, 3)
        self.classifier = Convolution(32, 32, 1)
        self.pool = nn.AvgPool2d(3, stride=2, padding=1)

    def forward(self, image: Tensor) -> Tensor:
        """The features of ``image``."""
        half = self.pool(image)
        first = self.level2_0(self.b1(torch.cat([self.level1(image), half], 1)))
        second = self.level3_0(self.b2(torch.cat([self.level2(first), first, self.pool(half)], 1)))
        joined = self.b3(torch.cat([second, self.level3(second)], 1))
        found: Tensor = self.classifier(self.conv_sa(self.sa(joined)) + self.conv_sc(self.sc(joined)))
        return found


class TwinLiteNet(nn.Module):
    """The network: from an image, n x 3 x h x w, RGB 0..1, to the logits of area and lines, n x 2 x h x w each."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = Encoder()
        self.up_1_1, self.up_2_1, self.classifier_1 = (
            Enlargement(32, 16),
            Enlargement(16, 8),
            Enlargement(8, 2),
        )
        self.up_1_2, self.up_2_2, self.classifier_2 = (
            Enlargement(32, 16),
            Enlargement(16, 8),
            Enlargement(8, 2),
        )

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Area and lines of ``image``."""
        features = self.encoder(image)
        area = self.classifier_1(self.up_2_1(self.up_1_1(features)))
        return area, self.classifier_2(self.up_2_2(self.up_1_2(features)))


def to_onnx(checkpoint: bytes, about: SegmentNetwork, source: str) -> bytes:
    """The ONNX file of a checkpoint, with the size and the names of ``about``.

    Weights below ``LEAST``, which decay has left in dead channels, become zero: many processors compute several
    times as slowly with denormal numbers. Raises InputError, which names ``source``, for another file.
    """
    network = TwinLiteNet()
    try:
        weights = torch.load(io.BytesIO(checkpoint), map_location="cpu", weights_only=True)
        network.load_state_dict({name.removeprefix(PREFIX): value for name, value in weights.items()})
    except Exception as error:  # torch.load raises what its unpickler meets
        why = line_of(error) or type(error).__name__
        raise InputError(f"{source}: no checkpoint of TwinLiteNet: {why}") from error
    with torch.no_grad():
        for weights in network.parameters():
            weights[weights.abs() < LEAST] = 0.0
    assert about.lines is not None and about.area is not None
    written = io.BytesIO()
    torch.onnx.export(
        network.eval(),
        (torch.zeros(1, 3, about.input.height, about.input.width),),
        written,
        input_names=[about.input.name],
        output_names=[about.area.output, about.lines.output],
        opset_version=OPSET,
        dynamo=False,
    )
    return written.getvalue()
