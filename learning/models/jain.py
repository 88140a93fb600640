"""Jain (Working Model of Self-driving Car, ICECA 2018; N10): 128 inputs, 32, 32, and 4 classes of commands.

Frame 8 x 16, grey, 0 to 1, so that the 128 pixels are the inputs: 128·32 + 32 + 32·32 + 32 + 32·4 + 4 = 5 316
weights. The classes are left, forward and right, at 1, 0 and −1 of the unit, and a fourth, stop, which drives have
no label for: it stays without a frame and has the angle of forward.
"""

from torch import nn

from learning.models.parts.heads import Categorical, Head
from learning.models.parts.network import Size, SteeringNetwork, dense, glorot
from learning.models.parts.view import View

CENTRES = (1.0, 0.0, -1.0, 0.0)  # left, forward, right, stop


def jain(size: Size, head: Head) -> SteeringNetwork:
    """The network; its four classes replace the bins of the head ``categorical``."""
    if isinstance(head, Categorical):
        head = Categorical(CENTRES)
    network = SteeringNetwork(size, View(colour="grey"), nn.Identity(), dense(32, 32), head)
    glorot(network)
    return network
