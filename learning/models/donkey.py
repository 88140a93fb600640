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

The output for the throttle is left out (51 and 1 020 weights).
"""

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense, glorot
from learning.models.parts.view import View

DROPOUT = 0.2


def linear(size: Size, head: Head) -> SteeringNetwork:
    """``default_n_linear``."""
    return _donkey(size, head, stride=1)


def categorical(size: Size, head: Head) -> SteeringNetwork:
    """``default_categorical``."""
    return _donkey(size, head, stride=2)


def _donkey(size: Size, head: Head, *, stride: int) -> SteeringNetwork:
    layers = ((24, 5, 2), (32, 5, 2), (64, 5, 2), (64, 3, stride), (64, 3, 1))
    trunk = convolutions(3, layers, dropout=DROPOUT)
    network = SteeringNetwork(size, View(), trunk, dense(100, 50, dropout=DROPOUT), head)
    glorot(network)
    return network
