"""Trepid's own networks: the least error for a millisecond on one core.

``steer``: frame 60 x 80, RGB, each with mean 0 and deviation 1; padded convolutions with batch normalisation:
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
