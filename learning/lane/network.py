"""The network behind the CNN estimator, its loss and its ONNX export. Needs torch (extra ``[train]``)."""

from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

# offset [m], heading [rad], curvature at the axle, curvature at the look-ahead [1/m], width [m]
LANE_SIZE = 5
COURSE_SIZE = 4  # of them without the width
CONVOLUTIONS = ((24, 5, 2), (36, 5, 2), (48, 5, 2), (64, 3, 1), (64, 3, 1))  # channels, kernel, stride
DENSE = (100, 50)
LOG_SIGMA_RANGE = (-5.0, 3.0)  # of an output in units of its spread: keeps the loss finite
FLOOR_GREY = 8.0  # added to the contrast [grey levels]: a black frame stays black


class SteerNetwork(nn.Module):
    """DAVE-2 (Bojarski et al., 2016): five convolutions and three dense layers, for 66 x 200 images.

    Batch normalisation follows each convolution; the export folds it in. One raw output row holds the lane, from
    its middle in units of its spread, the log standard deviations of the lane and of κ_cmd, and the logit of "a
    road is seen".
    """

    def __init__(
        self, lane_middle: Tensor, lane_spread: Tensor, lane_lookahead_m: float, command_lookahead_m: float
    ) -> None:
        super().__init__()
        self.register_buffer("lane_middle", lane_middle.float())
        self.register_buffer("lane_spread", lane_spread.float())
        self.register_buffer("command_row", command_row(lane_lookahead_m, command_lookahead_m))
        layers: list[nn.Module] = []
        before = 3
        for channels, kernel, stride in CONVOLUTIONS:
            layers += [
                nn.Conv2d(before, channels, kernel, stride, bias=False),
                nn.BatchNorm2d(channels),
                nn.ReLU(),
            ]
            before = channels
        layers += [nn.Flatten(), nn.LazyLinear(DENSE[0]), nn.ReLU(), nn.Linear(*DENSE), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(DENSE[-1], 2 * LANE_SIZE + 2))
        self.layers(torch.zeros(1, 3, 66, 200))  # sizes the first dense layer

    def forward(self, image: Tensor) -> Tensor:
        """Raw output rows, shape (n, 12), of uint8 BGR images, shape (n, 66, 200, 3)."""
        pixels = image.permute(0, 3, 1, 2).to(torch.float32)
        mean = pixels.mean(dim=(1, 2, 3), keepdim=True)
        spread = ((pixels - mean) ** 2).mean(dim=(1, 2, 3), keepdim=True).sqrt()
        return self.layers((pixels - mean) / (spread + FLOOR_GREY))

    @property
    def command_spread(self) -> Tensor:
        """Unit [1/m] of the log standard deviation of κ_cmd."""
        return (self.lane_spread[:COURSE_SIZE] * self.command_row).norm()


class ExportedNetwork(nn.Module):
    """The network with outputs in SI units: lane (n, 5), σ of κ_cmd [1/m] (n,), probability of a road (n,)."""

    def __init__(self, network: SteerNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        raw = self.network(image)
        lane = raw[:, :LANE_SIZE] * self.network.lane_spread + self.network.lane_middle
        sigma = raw[:, 2 * LANE_SIZE].clamp(*LOG_SIGMA_RANGE).exp() * self.network.command_spread
        return lane, sigma, torch.sigmoid(raw[:, 2 * LANE_SIZE + 1])


def command_row(lane_lookahead_m: float, command_lookahead_m: float) -> Tensor:
    """Row r with κ_cmd = r·course: pure pursuit, 2·y(ℓ)/ℓ² of the clothoid (:mod:`trepid.clothoid`).

    With κ' = (κ_a − κ₀)/a: κ_cmd = −2e/ℓ² − 2ψ/ℓ + κ₀·(1 − ℓ/3a) + κ_a·ℓ/3a.
    """
    reach, share = command_lookahead_m, command_lookahead_m / (3 * lane_lookahead_m)
    return torch.tensor([-2 / reach**2, -2 / reach, 1 - share, share])


def loss(network: SteerNetwork, raw: Tensor, lane: Tensor, visible: Tensor, *, beta: float) -> Tensor:
    """Mean β-NLL of the lane and of κ_cmd over the visible rows, plus cross-entropy of visibility.

    β-NLL weighs the Gaussian negative log likelihood with σ^(2β): plain NLL (β = 0) learns to be uncertain where
    it should learn to be right (Seitzer et al., On the Pitfalls of Heteroscedastic Uncertainty, ICLR 2022).
    """
    seen = visible > 0.5
    predicted = raw[:, :LANE_SIZE]
    off = predicted - (lane - network.lane_middle) / network.lane_spread
    weights = network.lane_spread[:COURSE_SIZE] * network.command_row / network.command_spread
    error = torch.cat([off, (off[:, :COURSE_SIZE] @ weights)[:, None]], dim=1)[seen]
    log_sigma = raw[:, LANE_SIZE : 2 * LANE_SIZE + 1].clamp(*LOG_SIGMA_RANGE)[seen]
    nll = 0.5 * (error * torch.exp(-log_sigma)) ** 2 + log_sigma
    weighed = nll * torch.exp(2 * beta * log_sigma).detach()
    visibility = nn.functional.binary_cross_entropy_with_logits(raw[:, 2 * LANE_SIZE + 1], visible)
    return weighed.sum() / max(int(seen.sum()), 1) / (LANE_SIZE + 1) + visibility


def export(network: SteerNetwork, path: Path) -> None:
    """Write the network as one ONNX file with a free batch size."""
    image = torch.from_numpy(np.zeros((2, 66, 200, 3), np.uint8))
    torch.onnx.export(
        ExportedNetwork(network).eval(),
        (image,),
        str(path),
        input_names=["image"],
        output_names=["lane", "command_sigma_1pm", "visible"],
        dynamic_axes={name: {0: "n"} for name in ("image", "lane", "command_sigma_1pm", "visible")},
        opset_version=17,
        dynamo=False,
    )
