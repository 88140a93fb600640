"""Networks of the literature and of donkeycar; sizes that a source does not give are chosen."""

from torch import nn

from learning.models.parts.heads import Categorical, Head
from learning.models.parts.memory import LSTM
from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense, glorot
from learning.models.parts.view import InputView

# Convolutions: channels, kernel, stride.
PILOTNET = ((24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1))
RAUSCH = ((24, 5, 2), (36, 5, 2), (48, 3, 2))
CHEN_HUANG = ((16, 8, 4), (32, 5, 2), (64, 5, 2))
CNN_LSTM = ((24, 5, 2), (32, 3, 2), (48, 3, 2), (64, 3, 2), (64, 3, 1), (64, 3, 1))
PILOTNET_CROP = 0.34  # share of the height
JAIN_CENTRES = (1.0, 0.0, -1.0, 0.0)  # left, forward, right, stop
LSTM_UNITS = 64
DONKEY_DROPOUT = 0.2


def pilotnet(size: Size, head: Head) -> SteeringNetwork:
    """DAVE-2, also PilotNet (Bojarski et al., End to End Learning for Self-Driving Cars, 2016; N01).

    Frame 100 x 200, of which the lower 66 rows, in YUV, −1 to 1:

        conv 5x5/2, 24 -> 31 x 98      1 824      conv 3x3, 64 -> 3 x 20    27 712
        conv 5x5/2, 36 -> 14 x 47     21 636      conv 3x3, 64 -> 1 x 18    36 928
        conv 5x5/2, 48 -> 5 x 22      43 248      dense 100, 50, 10        120 860
        together 252 208, and 11 for one output: 252 219 weights

    The "1164 neurons" of its figure are the flattened 1 x 18 x 64 = 1152 features.
    """
    view = InputView(crop_px=round(PILOTNET_CROP * size.height), colour="yuv", scaling="signed")
    network = SteeringNetwork(size, view, convolutions(3, PILOTNET), dense(100, 50, 10), head)
    glorot(network)
    return network


def rausch(size: Size, head: Head) -> SteeringNetwork:
    """Rausch et al. (Learning a Deep Neural Net Policy for End-to-End Control, ACC 2017; N08).

    Its source names 3 convolutions, 1 dense layer and an output; the sizes here are chosen. Frame 80 x 160, RGB,
    0 to 1:

        conv 5x5/2, 24 -> 38 x 78     1 824      dense 100    691 300
        conv 5x5/2, 36 -> 17 x 37    21 636      output           101
        conv 3x3/2, 48 ->  8 x 18    15 600
    """
    network = SteeringNetwork(size, InputView(), convolutions(3, RAUSCH), dense(100), head)
    glorot(network)
    return network


def jain(size: Size, head: Head) -> SteeringNetwork:
    """Jain (Working Model of Self-driving Car, ICECA 2018; N10): 128 inputs, 32, 32, and 4 classes of commands.

    Frame 8 x 16, grey, 0 to 1, so that the 128 pixels are the inputs: 128·32 + 32 + 32·32 + 32 + 32·4 + 4 = 5 316
    weights. The classes are left, forward and right, at 1, 0 and −1 of the unit, and a fourth, stop, which drives
    have no label for: it stays without a frame and has the angle of forward.

    The four classes replace the bins of the head ``categorical``.
    """
    if isinstance(head, Categorical):
        head = Categorical(JAIN_CENTRES)
    network = SteeringNetwork(size, InputView(colour="grey"), nn.Identity(), dense(32, 32), head)
    glorot(network)
    return network


def chen_huang(size: Size, head: Head) -> SteeringNetwork:
    """Chen and Huang (End-to-end Learning for Lane Keeping of Self-Driving Cars, IV 2017; N07).

    Its source names 3 convolutions, 4 ReLU and 3 dense layers; their sizes are those of the public baseline of
    comma.ai, whose drives it learned. Frame 160 x 320, RGB, −1 to 1, padded convolutions:

        conv 8x8/4, 16 -> 41 x 81      3 088      dense 512     7 569 920
        conv 5x5/2, 32 -> 21 x 41     12 832      dense 50         25 650
        conv 5x5/2, 64 -> 11 x 21     51 264      output               51

    The second dense layer has no ReLU, since the source counts four.
    """
    top = nn.Sequential(nn.Flatten(), nn.LazyLinear(512), nn.ReLU(), nn.Linear(512, 50))
    trunk = convolutions(3, CHEN_HUANG, same=True)
    network = SteeringNetwork(size, InputView(scaling="signed"), trunk, top, head)
    glorot(network)
    return network


def cnn_lstm(size: Size, head: Head) -> SteeringNetwork:
    """A CNN with a long short-term memory at its end (N05, N09: Haavaldsen et al. 2019).

    The source names 6 convolutions and 2 dense layers, and gives no sizes. Frame 60 x 80, each with mean 0 and
    deviation 1, padded convolutions with batch normalisation (its 2 weights a channel are counted):

        conv 5x5/2, 24 -> 30 x 40     1 848      conv 3x3, 64 -> 4 x 5      36 992
        conv 3x3/2, 32 -> 15 x 20     6 976      dense 100                 128 100
        conv 3x3/2, 48 ->  8 x 10    13 920      dense 50                    5 050
        conv 3x3/2, 64 ->  4 x 5     27 776      LSTM 64                    29 440
        conv 3x3, 64   ->  4 x 5     36 992      output                         65

    The state holds the features of the last frames of a window (:class:`LSTM`).
    """
    trunk = convolutions(3, CNN_LSTM, norm=True, same=True)
    return SteeringNetwork(
        size, InputView(scaling="contrast"), trunk, dense(100, 50), head, LSTM(50, LSTM_UNITS)
    )


def donkey_linear(size: Size, head: Head) -> SteeringNetwork:
    """``default_n_linear`` of donkeycar."""
    return _donkey(size, head, stride=1)


def donkey_categorical(size: Size, head: Head) -> SteeringNetwork:
    """``default_categorical`` of donkeycar."""
    return _donkey(size, head, stride=2)


def _donkey(size: Size, head: Head, *, stride: int) -> SteeringNetwork:
    """The networks of donkeycar (donkeycar/parts/keras.py of version 4 and 5): linear and categorical.

    Frame 120 x 160, RGB, 0 to 1; a dropout of 0.2 after every layer:

                                     linear               categorical
        conv 5x5/2, 24 -> 58 x 78     1 824                   1 824
        conv 5x5/2, 32 -> 27 x 37    19 232                  19 232
        conv 5x5/2, 64 -> 12 x 17    51 264                  51 264
        conv 3x3/s, 64               36 928 (10 x 15)        36 928 (s = 2: 5 x 8)
        conv 3x3, 64                 36 928 (8 x 13)         36 928 (3 x 6)
        dense 100                   665 700                 115 300
        dense 50                      5 050                   5 050
        angle                            51                     765 (15 bins)

    The output for the throttle (51 and 1 020 weights) is left out; ``speed: true`` in the recipe adds one for the
    speed, with 51 weights.
    """
    layers = ((24, 5, 2), (32, 5, 2), (64, 5, 2), (64, 3, stride), (64, 3, 1))
    trunk = convolutions(3, layers, dropout=DONKEY_DROPOUT)
    network = SteeringNetwork(size, InputView(), trunk, dense(100, 50, dropout=DONKEY_DROPOUT), head)
    glorot(network)
    return network
