"""A CNN with a long short-term memory at its end (N05, N09: Haavaldsen et al. 2019).

The source names 6 convolutions and 2 dense layers, and gives no sizes. Frame 60 x 80, each with mean 0 and
deviation 1, padded convolutions with batch normalisation (its 2 weights a channel are counted):

    conv 5x5/2, 24 -> 30 x 40     1 848      conv 3x3, 64 -> 4 x 5      36 992
    conv 3x3/2, 32 -> 15 x 20     6 976      dense 100                 128 100
    conv 3x3/2, 48 ->  8 x 10    13 920      dense 50                    5 050
    conv 3x3/2, 64 ->  4 x 5     27 776      LSTM 64                    29 440
    conv 3x3, 64   ->  4 x 5     36 992      output                         65
"""

from learning.models.parts.heads import Head
from learning.models.parts.memory import LSTM
from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense
from learning.models.parts.view import View

CONVOLUTIONS = ((24, 5, 2), (32, 3, 2), (48, 3, 2), (64, 3, 2), (64, 3, 1), (64, 3, 1))
UNITS = 64


def cnn_lstm(size: Size, head: Head) -> SteeringNetwork:
    """The network; its state holds the features of the last frames of a window (:class:`LSTM`)."""
    trunk = convolutions(3, CONVOLUTIONS, norm=True, same=True)
    return SteeringNetwork(size, View(scaling="contrast"), trunk, dense(100, 50), head, LSTM(50, UNITS))
