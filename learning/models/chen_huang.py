"""Chen and Huang (End-to-end Learning for Lane Keeping of Self-Driving Cars, IV 2017; N07).

Its source names 3 convolutions, 4 ReLU and 3 dense layers; their sizes are those of the public baseline of
comma.ai, whose drives it learned. Frame 160 x 320, RGB, −1 to 1, padded convolutions:

    conv 8x8/4, 16 -> 41 x 81      3 088      dense 512     7 569 920
    conv 5x5/2, 32 -> 21 x 41     12 832      dense 50         25 650
    conv 5x5/2, 64 -> 11 x 21     51 264      output               51
"""

from torch import nn

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork, convolutions, glorot
from learning.models.parts.view import View

CONVOLUTIONS = ((16, 8, 4), (32, 5, 2), (64, 5, 2))


def chen_huang(size: Size, head: Head) -> SteeringNetwork:
    """The network; its second dense layer has no ReLU, since its source counts four."""
    top = nn.Sequential(nn.Flatten(), nn.LazyLinear(512), nn.ReLU(), nn.Linear(512, 50))
    trunk = convolutions(3, CONVOLUTIONS, same=True)
    network = SteeringNetwork(size, View(scaling="signed"), trunk, top, head)
    glorot(network)
    return network
