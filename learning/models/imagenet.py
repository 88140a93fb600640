"""Trunks that have learned ImageNet, without classifier: InceptionV3, VGG16, VGG19.

InceptionV3 (Szegedy et al., Rethinking the Inception Architecture, CVPR 2016):
frame 240 x 320 -> 6 x 8 x 2048. 21 785 568 weights in the layout of torchvision's ``inception_v3``; Keras counts
21 802 784, because it has no gain in its batch normalisation and counts its two statistics instead: one number more
for each of the 17 216 channels.

VGG16 and VGG19 (Simonyan and Zisserman, Very Deep Convolutional Networks, ICLR 2015):
frame 240 x 320 -> 7 x 10 x 512; 14 714 688 and 20 024 384 weights in the layout of torchvision's ``vgg16`` and
``vgg19`` (``features.…``).
"""

from typing import Any

import torch
from torch import Tensor, nn

CHANNELS = 2048
EPSILON = 1e-3


class Convolution(nn.Module):
    """Convolution without bias, batch normalisation, ReLU."""

    def __init__(self, before: int, channels: int, kernel: int | tuple[int, int], **options: Any) -> None:
        super().__init__()
        self.conv = nn.Conv2d(before, channels, kernel, bias=False, **options)
        self.bn = nn.BatchNorm2d(channels, eps=EPSILON)

    def forward(self, x: Tensor) -> Tensor:
        return nn.functional.relu(self.bn(self.conv(x)))


class BlockA(nn.Module):
    """Branches 1x1, 5x5, double 3x3, pool; at 35 x 35 in the source."""

    def __init__(self, before: int, pooled: int) -> None:
        super().__init__()
        self.branch1x1 = Convolution(before, 64, 1)
        self.branch5x5_1 = Convolution(before, 48, 1)
        self.branch5x5_2 = Convolution(48, 64, 5, padding=2)
        self.branch3x3dbl_1 = Convolution(before, 64, 1)
        self.branch3x3dbl_2 = Convolution(64, 96, 3, padding=1)
        self.branch3x3dbl_3 = Convolution(96, 96, 3, padding=1)
        self.branch_pool = Convolution(before, pooled, 1)

    def forward(self, x: Tensor) -> Tensor:
        double = self.branch3x3dbl_3(self.branch3x3dbl_2(self.branch3x3dbl_1(x)))
        branches = [
            self.branch1x1(x),
            self.branch5x5_2(self.branch5x5_1(x)),
            double,
            self.branch_pool(_pool(x)),
        ]
        return torch.cat(branches, 1)


class BlockB(nn.Module):
    """Half the size: 3x3/2, double 3x3/2, pool."""

    def __init__(self, before: int) -> None:
        super().__init__()
        self.branch3x3 = Convolution(before, 384, 3, stride=2)
        self.branch3x3dbl_1 = Convolution(before, 64, 1)
        self.branch3x3dbl_2 = Convolution(64, 96, 3, padding=1)
        self.branch3x3dbl_3 = Convolution(96, 96, 3, stride=2)

    def forward(self, x: Tensor) -> Tensor:
        double = self.branch3x3dbl_3(self.branch3x3dbl_2(self.branch3x3dbl_1(x)))
        return torch.cat([self.branch3x3(x), double, nn.functional.max_pool2d(x, 3, 2)], 1)


class BlockC(nn.Module):
    """Branches 1x1, 7x7 and double 7x7 as 1x7 and 7x1, pool; at 17 x 17 in the source."""

    def __init__(self, before: int, inner: int) -> None:
        super().__init__()
        row: dict[str, Any] = dict(kernel=(1, 7), padding=(0, 3))
        column: dict[str, Any] = dict(kernel=(7, 1), padding=(3, 0))
        self.branch1x1 = Convolution(before, 192, 1)
        self.branch7x7_1 = Convolution(before, inner, 1)
        self.branch7x7_2 = Convolution(inner, inner, **row)
        self.branch7x7_3 = Convolution(inner, 192, **column)
        self.branch7x7dbl_1 = Convolution(before, inner, 1)
        self.branch7x7dbl_2 = Convolution(inner, inner, **column)
        self.branch7x7dbl_3 = Convolution(inner, inner, **row)
        self.branch7x7dbl_4 = Convolution(inner, inner, **column)
        self.branch7x7dbl_5 = Convolution(inner, 192, **row)
        self.branch_pool = Convolution(before, 192, 1)

    def forward(self, x: Tensor) -> Tensor:
        single = self.branch7x7_3(self.branch7x7_2(self.branch7x7_1(x)))
        double = self.branch7x7dbl_3(self.branch7x7dbl_2(self.branch7x7dbl_1(x)))
        double = self.branch7x7dbl_5(self.branch7x7dbl_4(double))
        return torch.cat([self.branch1x1(x), single, double, self.branch_pool(_pool(x))], 1)


class BlockD(nn.Module):
    """Half the size: 3x3/2, 7x7 and 3x3/2, pool."""

    def __init__(self, before: int) -> None:
        super().__init__()
        self.branch3x3_1 = Convolution(before, 192, 1)
        self.branch3x3_2 = Convolution(192, 320, 3, stride=2)
        self.branch7x7x3_1 = Convolution(before, 192, 1)
        self.branch7x7x3_2 = Convolution(192, 192, (1, 7), padding=(0, 3))
        self.branch7x7x3_3 = Convolution(192, 192, (7, 1), padding=(3, 0))
        self.branch7x7x3_4 = Convolution(192, 192, 3, stride=2)

    def forward(self, x: Tensor) -> Tensor:
        seven = self.branch7x7x3_3(self.branch7x7x3_2(self.branch7x7x3_1(x)))
        branches = [
            self.branch3x3_2(self.branch3x3_1(x)),
            self.branch7x7x3_4(seven),
            nn.functional.max_pool2d(x, 3, 2),
        ]
        return torch.cat(branches, 1)


class BlockE(nn.Module):
    """Branches 1x1, 3x3 and double 3x3 that end in 1x3 beside 3x1, pool; at 8 x 8 in the source."""

    def __init__(self, before: int) -> None:
        super().__init__()
        row: dict[str, Any] = dict(kernel=(1, 3), padding=(0, 1))
        column: dict[str, Any] = dict(kernel=(3, 1), padding=(1, 0))
        self.branch1x1 = Convolution(before, 320, 1)
        self.branch3x3_1 = Convolution(before, 384, 1)
        self.branch3x3_2a = Convolution(384, 384, **row)
        self.branch3x3_2b = Convolution(384, 384, **column)
        self.branch3x3dbl_1 = Convolution(before, 448, 1)
        self.branch3x3dbl_2 = Convolution(448, 384, 3, padding=1)
        self.branch3x3dbl_3a = Convolution(384, 384, **row)
        self.branch3x3dbl_3b = Convolution(384, 384, **column)
        self.branch_pool = Convolution(before, 192, 1)

    def forward(self, x: Tensor) -> Tensor:
        single = self.branch3x3_1(x)
        double = self.branch3x3dbl_2(self.branch3x3dbl_1(x))
        branches = [
            self.branch1x1(x),
            *(self.branch3x3_2a(single), self.branch3x3_2b(single)),
            *(self.branch3x3dbl_3a(double), self.branch3x3dbl_3b(double)),
            self.branch_pool(_pool(x)),
        ]
        return torch.cat(branches, 1)


class InceptionV3(nn.Sequential):
    """The trunk; the names of its parts are those of torchvision."""

    def __init__(self) -> None:
        super().__init__()
        parts: dict[str, nn.Module] = {
            "Conv2d_1a_3x3": Convolution(3, 32, 3, stride=2),
            "Conv2d_2a_3x3": Convolution(32, 32, 3),
            "Conv2d_2b_3x3": Convolution(32, 64, 3, padding=1),
            "maxpool1": nn.MaxPool2d(3, 2),
            "Conv2d_3b_1x1": Convolution(64, 80, 1),
            "Conv2d_4a_3x3": Convolution(80, 192, 3),
            "maxpool2": nn.MaxPool2d(3, 2),
            "Mixed_5b": BlockA(192, 32),
            "Mixed_5c": BlockA(256, 64),
            "Mixed_5d": BlockA(288, 64),
            "Mixed_6a": BlockB(288),
            "Mixed_6b": BlockC(768, 128),
            "Mixed_6c": BlockC(768, 160),
            "Mixed_6d": BlockC(768, 160),
            "Mixed_6e": BlockC(768, 192),
            "Mixed_7a": BlockD(768),
            "Mixed_7b": BlockE(1280),
            "Mixed_7c": BlockE(2048),
        }
        for name, part in parts.items():
            self.add_module(name, part)


def _pool(x: Tensor) -> Tensor:
    return nn.functional.avg_pool2d(x, 3, 1, 1)


VGG16 = (2, 2, 3, 3, 3)
VGG19 = (2, 2, 4, 4, 4)
VGG_CHANNELS = (64, 128, 256, 512, 512)


class VGG(nn.Module):
    """Convolutions 3x3 in five groups, each followed by a pool of 2x2; ``repeats``: convolutions in a group."""

    def __init__(self, repeats: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 3
        for count, channels in zip(repeats, VGG_CHANNELS, strict=True):
            for _ in range(count):
                layers += [nn.Conv2d(before, channels, 3, padding=1), nn.ReLU()]
                before = channels
            layers.append(nn.MaxPool2d(2))
        self.features = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        return self.features(x)
