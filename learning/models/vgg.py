"""The trunks of VGG16 and VGG19 (Simonyan and Zisserman, Very Deep Convolutional Networks, ICLR 2015).

Frame 240 x 320 -> 7 x 10 x 512; 14 714 688 and 20 024 384 weights in the layout of torchvision's ``vgg16`` and
``vgg19`` (``features.…``).
"""

from torch import Tensor, nn

VGG16 = (2, 2, 3, 3, 3)
VGG19 = (2, 2, 4, 4, 4)
CHANNELS = (64, 128, 256, 512, 512)


class VGG(nn.Module):
    """Convolutions 3x3 in five groups, each followed by a pool of 2x2; ``repeats``: convolutions in a group."""

    def __init__(self, repeats: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        before = 3
        for count, channels in zip(repeats, CHANNELS, strict=True):
            for _ in range(count):
                layers += [nn.Conv2d(before, channels, 3, padding=1), nn.ReLU()]
                before = channels
            layers.append(nn.MaxPool2d(2))
        self.features = nn.Sequential(*layers)

    def forward(self, x: Tensor) -> Tensor:
        return self.features(x)
