"""Rausch et al. (Learning a Deep Neural Net Policy for End-to-End Control, ACC 2017; N08).

Its source names 3 convolutions, 1 dense layer and an output; the sizes here are chosen. Frame 80 x 160, RGB,
0 to 1:

    conv 5x5/2, 24 -> 38 x 78     1 824      dense 100    691 300
    conv 5x5/2, 36 -> 17 x 37    21 636      output           101
    conv 3x3/2, 48 ->  8 x 18    15 600
"""

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense, glorot
from learning.models.parts.view import View

CONVOLUTIONS = ((24, 5, 2), (36, 5, 2), (48, 3, 2))


def rausch(size: Size, head: Head) -> SteeringNetwork:
    """The network."""
    network = SteeringNetwork(size, View(), convolutions(3, CONVOLUTIONS), dense(100), head)
    glorot(network)
    return network
