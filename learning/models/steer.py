"""Trepid's own network, for one core.

``steer``: frame 60 x 80, RGB, each with mean 0 and deviation 1; padded convolutions with batch normalisation (its 2
weights a channel are counted):

    conv 5x5/2, 24 -> 30 x 40     1 848      conv 3x3/2, 64 -> 4 x 5     36 992
    conv 3x3/2, 32 -> 15 x 20     6 976      dense 64                    81 984
    conv 3x3/2, 48 ->  8 x 10    13 920      angle and log scale            130
    conv 3x3, 64   ->  8 x 10    27 776      together                   169 626
"""

from torch import nn

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork, convolutions
from learning.models.parts.view import View

CONVOLUTIONS = ((24, 5, 2), (32, 3, 2), (48, 3, 2), (64, 3, 1), (64, 3, 2))
DENSE = 64
DROPOUT = 0.3


def steer(size: Size, head: Head) -> SteeringNetwork:
    """The network."""
    trunk = convolutions(3, CONVOLUTIONS, norm=True, same=True)
    top = nn.Sequential(
        nn.Flatten(), nn.Dropout(DROPOUT), nn.LazyLinear(DENSE), nn.ReLU(), nn.Dropout(DROPOUT)
    )
    return SteeringNetwork(size, View(scaling="contrast"), trunk, top, head)
