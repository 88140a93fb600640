"""DAVE-2, also PilotNet (Bojarski et al., End to End Learning for Self-Driving Cars, 2016; N01).

Frame 100 x 200, of which the lower 66 rows, in YUV, −1 to 1:

    conv 5x5/2, 24 -> 31 x 98      1 824      conv 3x3, 64 -> 3 x 20    27 712
    conv 5x5/2, 36 -> 14 x 47     21 636      conv 3x3, 64 -> 1 x 18    36 928
    conv 5x5/2, 48 -> 5 x 22      43 248      dense 100, 50, 10        120 860
    together 252 208, and 11 for one output: 252 219 weights

The "1164 neurons" of its figure are the flattened 1 x 18 x 64 = 1152 features.
"""

from learning.models.parts.heads import Head
from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense, glorot
from learning.models.parts.view import View

CONVOLUTIONS = ((24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1))  # channels, kernel, stride
DENSE = (100, 50, 10)
CROP_SHARE = 0.34


def pilotnet(size: Size, head: Head) -> SteeringNetwork:
    view = View(crop_px=round(CROP_SHARE * size.height), colour="yuv", scaling="signed")
    network = SteeringNetwork(size, view, convolutions(3, CONVOLUTIONS), dense(*DENSE), head)
    glorot(network)
    return network
