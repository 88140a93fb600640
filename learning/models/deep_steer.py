"""The networks of Deep Steer (N13, N16): a trunk that has learned ImageNet, and the paper's top.

Frame 240 x 320, RGB. Top: global average pool, dense 1024 with ReLU, one linear output [rad].

    InceptionV3: 21 785 568 + 2 098 176 + 1 025 = 23 884 769 (Keras: 23 901 985, see learning.models.imagenet)
    VGG16:       14 714 688 +   525 312 + 1 025 = 15 241 025
    VGG19:       20 024 384 +   525 312 + 1 025 = 20 550 721

With the memory, SimpleRNN(128) between dense layer and output: 147 584 weights, and 129 of the output; together
24 031 457, or 24 048 673 as Keras counts. As printed, its sequence has the length 1: its state is zero in every
frame, and the network has no memory. As a sequence the state passes from frame to frame.

The weights of the trunk are random unless the recipe names a file for ``weights``.
"""

from torch import Tensor, nn

from learning.models.imagenet import VGG, VGG16, VGG19, InceptionV3
from learning.models.parts.heads import Head
from learning.models.parts.memory import SimpleRNN
from learning.models.parts.network import Size, SteeringNetwork, glorot
from learning.models.parts.view import InputView

DENSE = 1024
UNITS = 128


class WithoutPast(nn.Module):
    """A recurrent layer on sequences of length 1."""

    def __init__(self, memory: SimpleRNN) -> None:
        super().__init__()
        self.memory = memory

    def forward(self, features: Tensor) -> Tensor:
        return self.memory(features[:, None])[:, 0]


def inception_v3(size: Size, head: Head) -> SteeringNetwork:
    """InceptionV3 and the top. Its trunk reads −1 to 1, as Keras and the public weights of TensorFlow."""
    return with_top(size, head, InceptionV3(), InputView(scaling="signed"))


def vgg16(size: Size, head: Head) -> SteeringNetwork:
    """VGG16 and the top."""
    return with_top(size, head, VGG(VGG16), InputView(scaling="imagenet"))


def vgg19(size: Size, head: Head) -> SteeringNetwork:
    """VGG19 and the top."""
    return with_top(size, head, VGG(VGG19), InputView(scaling="imagenet"))


def rnn_as_printed(size: Size, head: Head) -> SteeringNetwork:
    """InceptionV3, the top, and SimpleRNN on sequences of length 1."""
    return with_top(
        size, head, InceptionV3(), InputView(scaling="signed"), WithoutPast(SimpleRNN(DENSE, UNITS))
    )


def rnn(size: Size, head: Head) -> SteeringNetwork:
    """InceptionV3, the top, and SimpleRNN on true sequences, stateful at run time."""
    return with_top(size, head, InceptionV3(), InputView(scaling="signed"), memory=SimpleRNN(DENSE, UNITS))


def with_top(
    size: Size,
    head: Head,
    trunk: nn.Module,
    view: InputView,
    last: nn.Module | None = None,
    memory: SimpleRNN | None = None,
) -> SteeringNetwork:
    """``trunk`` under the top of the paper; ``last`` or ``memory`` stands between dense layer and output."""
    top = nn.Sequential(nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.LazyLinear(DENSE), nn.ReLU())
    if last is not None:
        top.append(last)
    network = SteeringNetwork(size, view, trunk, top, head, memory)
    glorot(network.top)
    glorot(network.head)
    return network
