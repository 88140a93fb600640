"""The small network behind the lead detector, its loss and its ONNX export. Needs torch (extra ``[train]``)."""

from pathlib import Path

import numpy as np
import onnx
import torch
from torch import Tensor, nn

from learning.lead.frames import HIDDEN, MIN_VISIBLE
from perception.lead.view import CELLS_LEFT_M, COLUMNS, DISTANCES_M, RATIO, ROWS, STRIPS

OUTPUTS = ("logit", "ahead", "left", "log_width")
"""Per cell: existence of the end of a vehicle; ln(its distance over the strip's) in units of ln RATIO; metres
to the left of the cell; ln(width over USUAL_WIDTH_M)."""
USUAL_WIDTH_M = 1.8
FLOOR_GREY = 8.0  # added to the contrast of a strip [grey levels]: a black strip stays black
NEAR_STEPS, NEAR_LEFT_M = 0.75, 0.4  # cells this close to the end of a vehicle are positive …
CLOSE_STEPS, CLOSE_LEFT_M = 2.5, 1.2  # … cells this close do not count in the loss
POSITIVE_WEIGHT, BOX_WEIGHT = 4.0, 2.0
FOCUS = 2.0  # Lin et al., Focal Loss for Dense Object Detection (ICCV 2017)


class LeadNetwork(nn.Module):
    """Five convolutions over strips (n, ROWS, COLUMNS, 3): 47 million multiply-adds for the 33 strips of a frame.

    The rows are reduced to one, the columns halved. A cell has a receptive field of 6.4 m of one strip: it sees
    both flanks of a vehicle, and whether a shadow or a reflection goes on beyond.
    """

    def __init__(self) -> None:
        super().__init__()
        self.layers = nn.Sequential(
            nn.Conv2d(3, 16, 4, stride=2, padding=1, bias=False),  # (ROWS / 2, CELL_COLUMNS)
            nn.BatchNorm2d(16),
            nn.ReLU(),
            nn.Conv2d(16, 16, 3, stride=(2, 1), padding=1, bias=False),  # (ROWS / 4, CELL_COLUMNS)
            nn.BatchNorm2d(16),
            nn.ReLU(),
            nn.Conv2d(16, 32, (ROWS // 4, 5), padding=(0, 2), bias=False),
            nn.BatchNorm2d(32),
            nn.ReLU(),
            nn.Conv2d(32, 32, (1, 3), padding=(0, 3), dilation=(1, 3), bias=False),
            nn.BatchNorm2d(32),
            nn.ReLU(),
            nn.Conv2d(32, len(OUTPUTS), (1, 3), padding=(0, 1)),
        )
        nn.init.constant_(self.layers[-1].bias[:1], -4.0)  # vehicles are rare

    def forward(self, strips: Tensor) -> Tensor:
        """Raw outputs, shape (n, OUTPUTS, CELL_COLUMNS), of uint8 strips."""
        pixels = strips.to(torch.float32)
        apart = pixels - pixels.mean(dim=(1, 2, 3), keepdim=True)
        spread = (apart * apart).mean(dim=(1, 2, 3), keepdim=True).sqrt()
        return self.layers((apart / (spread + FLOOR_GREY)).permute(0, 3, 1, 2))[:, :, 0]


class Targets(nn.Module):
    """Targets of the cells of a frame."""

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("log_m", torch.from_numpy(np.log(DISTANCES_M)).float()[:, None, None])
        self.register_buffer("left_m", torch.from_numpy(CELLS_LEFT_M).float()[None, :, None])

    def forward(self, vehicles: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Targets (n, STRIPS, OUTPUTS, CELL_COLUMNS), positive and counted cells of vehicles (n, m, LABEL)."""
        ahead, left, width, visible = vehicles[:, None, None].unbind(-1)
        there = torch.isfinite(ahead) & (ahead > 0) & (visible > HIDDEN)
        steps = (ahead.clamp(min=0.1).log() - self.log_m[None]) / float(np.log(RATIO))
        aside = left - self.left_m[None]
        off = (steps / CLOSE_STEPS).abs().maximum((aside / CLOSE_LEFT_M).abs())
        off = torch.where(there, off, torch.inf)
        near = there & (visible >= MIN_VISIBLE) & (steps.abs() <= NEAR_STEPS) & (aside.abs() <= NEAR_LEFT_M)
        positive = near.any(-1)
        asked = positive | (off > 1.0).all(-1)
        nearest = off.argmin(-1, keepdim=True)

        def of_nearest(values: Tensor) -> Tensor:
            return values.expand_as(off).gather(-1, nearest)[..., 0]

        box = [of_nearest(steps), of_nearest(aside), of_nearest((width / USUAL_WIDTH_M).log())]
        wanted = torch.stack([positive.float(), *box], dim=2)
        return torch.nan_to_num(wanted), positive, asked


def loss(raw: Tensor, wanted: Tensor, positive: Tensor, asked: Tensor) -> Tensor:
    """Focal cross-entropy over the counted cells plus the absolute error of place and width of positive ones."""
    logit = raw[:, :, 0]
    entropy = nn.functional.binary_cross_entropy_with_logits(logit, wanted[:, :, 0], reduction="none")
    wrong = (wanted[:, :, 0] - torch.sigmoid(logit)).abs() ** FOCUS
    weight = torch.where(positive, POSITIVE_WEIGHT, 1.0) * asked
    count = positive.sum().clamp(min=1)
    box = ((raw[:, :, 1:] - wanted[:, :, 1:]).abs() * positive[:, :, None]).sum() / count
    return (entropy * wrong * weight).sum() / count + BOX_WEIGHT * box


class ExportedLeadNetwork(nn.Module):
    """The network with probabilities instead of logits: (n, OUTPUTS, CELL_COLUMNS)."""

    def __init__(self, network: LeadNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, strips: Tensor) -> Tensor:
        raw = self.network(strips)
        return torch.cat([torch.sigmoid(raw[:, :1]), raw[:, 1:]], dim=1)


def load_network(path: Path) -> LeadNetwork:
    """The network of an ONNX file that ``export`` wrote. Raises ValueError for another network.

    The export has folded the normalisation into the convolutions, so it is the identity here: fit it in mode eval.
    """
    graph = onnx.load(str(path)).graph
    values = {one.name: torch.from_numpy(onnx.numpy_helper.to_array(one).copy()) for one in graph.initializer}
    convolutions = [node.input[1:3] for node in graph.node if node.op_type == "Conv"]
    network = LeadNetwork()
    own = [layer for layer in network.layers if isinstance(layer, nn.Conv2d)]
    norms = [layer for layer in network.layers if isinstance(layer, nn.BatchNorm2d)]
    if len(own) != len(convolutions):
        raise ValueError(f"{path}: {len(convolutions)} convolutions, not {len(own)}")
    with torch.no_grad():
        for layer, norm, (weight, bias) in zip(own, [*norms, None], convolutions, strict=True):
            layer.weight.copy_(values[weight])
            if norm is None:
                assert layer.bias is not None
                layer.bias.copy_(values[bias])
            else:
                norm.running_var.fill_(1 - norm.eps)
                norm.bias.copy_(values[bias])
    return network.eval()


def export(network: LeadNetwork, path: Path) -> None:
    """Write the network for any number of strips as one ONNX file."""
    strips = torch.zeros((STRIPS, ROWS, COLUMNS, 3), dtype=torch.uint8)
    torch.onnx.export(
        ExportedLeadNetwork(network).eval(),
        (strips,),
        str(path),
        input_names=["strips"],
        output_names=["cells"],
        dynamic_axes={"strips": {0: "strips"}, "cells": {0: "strips"}},
        opset_version=17,
        dynamo=False,
    )
