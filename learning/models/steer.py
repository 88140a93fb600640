"""Trepid's own networks, for one core.

``steer``: frame 60 x 80, RGB, each with mean 0 and deviation 1; padded convolutions with batch normalisation (its 2
weights a channel are counted):

    conv 5x5/2, 24 -> 30 x 40     1 848      conv 3x3/2, 64 -> 4 x 5     36 992
    conv 3x3/2, 32 -> 15 x 20     6 976      dense 64                    81 984
    conv 3x3/2, 48 ->  8 x 10    13 920      angle and log scale            130
    conv 3x3, 64   ->  8 x 10    27 776      together                   169 626

``steer-motion``: the same, and the shifts of the view to the side between the last frames, BEFORE of them
(:class:`Shift`): dense 64 and 6 numbers -> dense 32; these and the 6 numbers -> angle and log scale, 171 846
weights together. In recorded drives this motion shows how far the wheel is turned at present; a network that only
keeps up this angle imitates well and drives badly (de Haan et al., Causal Confusion in Imitation Learning, NeurIPS
2019). It depends on the frame rate of the training.

``steer-lstm``: the network of one frame, and a long short-term memory of 32 units (12 672) of its dense layer and
of the shift of the view since the frame before; their 34 numbers -> angle and log scale (70), 182 238 weights
together (:class:`ShiftedLSTM`). The camera shows the road from some metres ahead of the axle on; the memory holds
what it showed of the place where the car is now. It too depends on the frame rate of the training.
"""

from torch import nn

from learning.models.parts.heads import Head
from learning.models.parts.memory import Memory
from learning.models.parts.motion import Shift, ShiftedLSTM
from learning.models.parts.network import Size, SteeringNetwork, convolutions
from learning.models.parts.view import InputView

CONVOLUTIONS = ((24, 5, 2), (32, 3, 2), (48, 3, 2), (64, 3, 1), (64, 3, 2))
DENSE = 64
DROPOUT = 0.3
BEFORE = 3
JOINED = 32
UNITS = 32


def steer(size: Size, head: Head) -> SteeringNetwork:
    """The network of one frame."""
    return _network(size, head)


def motion(size: Size, head: Head) -> SteeringNetwork:
    """The network of a frame and of the shift of the view."""
    return _network(size, head, Shift(size, BEFORE, JOINED))


def lstm(size: Size, head: Head) -> SteeringNetwork:
    """The network of a frame, of the shift of the view, and of what the frames before showed."""
    return _network(size, head, ShiftedLSTM(size, DENSE, UNITS))


def _network(size: Size, head: Head, memory: Memory | None = None) -> SteeringNetwork:
    trunk = convolutions(3, CONVOLUTIONS, norm=True, same=True)
    top = nn.Sequential(
        nn.Flatten(), nn.Dropout(DROPOUT), nn.LazyLinear(DENSE), nn.ReLU(), nn.Dropout(DROPOUT)
    )
    return SteeringNetwork(size, InputView(scaling="contrast"), trunk, top, head, memory)
