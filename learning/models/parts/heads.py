"""From features to an angle and its error scale, in units of the network; and the loss of them."""

import math
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn

Loss = Literal["mse", "mae", "huber"]  # of the head "regression"; the others have their likelihood
HeadName = Literal["regression", "gaussian", "laplace", "categorical"]
LOG_RANGE = (-6.0, 3.0)  # of an error scale in units of the network: keeps the loss finite
HUBER_DELTA = 0.1  # in units of the network
BINS = 15  # donkeycar
CENTRES = tuple(np.linspace(-1, 1, BINS).tolist())


class Head(nn.Module):
    """A linear layer of ``size`` outputs. Subclasses read angle and error scale from its rows."""

    size = 1
    sigma: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.linear = nn.LazyLinear(self.size)
        self.register_buffer(
            "sigma", torch.tensor(1.0)
        )  # of heads without an error scale: set after training

    def forward(self, features: Tensor) -> Tensor:
        return self.linear(features)

    def angle(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        """Angle and standard deviation of its error, of rows (…, size)."""
        return raw[..., 0], self.sigma.expand_as(raw[..., 0])

    def losses(self, raw: Tensor, wanted: Tensor, *, loss: Loss, beta: float) -> Tensor:
        """The loss of each row, of the shape of ``wanted``."""
        error = raw[..., 0] - wanted
        if loss == "mse":
            return error**2
        if loss == "mae":
            return error.abs()
        return nn.functional.huber_loss(raw[..., 0], wanted, reduction="none", delta=HUBER_DELTA)


class Gaussian(Head):
    """Angle and log σ of a normal error.

    β-NLL: the negative log likelihood with the weight σ^(2β) (Seitzer et al., On the Pitfalls of Heteroscedastic
    Uncertainty, ICLR 2022).
    """

    size = 2

    def angle(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        return raw[..., 0], raw[..., 1].clamp(*LOG_RANGE).exp()

    def losses(self, raw: Tensor, wanted: Tensor, *, loss: Loss, beta: float) -> Tensor:
        log_sigma = raw[..., 1].clamp(*LOG_RANGE)
        nll = 0.5 * ((raw[..., 0] - wanted) * (-log_sigma).exp()) ** 2 + log_sigma
        return nll * (2 * beta * log_sigma).exp().detach()


class Laplace(Head):
    """Angle and log b of a Laplace error, whose deviation is √2·b: the angle is the median of the labels.

    The negative log likelihood |e|/b + ln b, with the weight b^β as of :class:`Gaussian`. Few labels are far off,
    and many recorded ones are exactly zero, so that the median has the least mean absolute error.
    """

    size = 2

    def angle(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        return raw[..., 0], raw[..., 1].clamp(*LOG_RANGE).exp() * math.sqrt(2)

    def losses(self, raw: Tensor, wanted: Tensor, *, loss: Loss, beta: float) -> Tensor:
        log_scale = raw[..., 1].clamp(*LOG_RANGE)
        nll = (raw[..., 0] - wanted).abs() * (-log_scale).exp() + log_scale
        return nll * (beta * log_scale).exp().detach()


class Categorical(Head):
    """Probabilities of BINS angles from −1 to 1, as of donkeycar; the angle is the likeliest bin.

    The deviation is that of the probabilities about this bin, with half a bin added in squares.
    """

    centres: Tensor

    def __init__(self, centres: tuple[float, ...] = CENTRES) -> None:
        self.size = len(centres)
        super().__init__()
        self.register_buffer("centres", torch.tensor(centres))

    def angle(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        share = raw.softmax(-1)
        angle = self.centres[raw.argmax(-1)]
        squared = (share * (self.centres - angle[..., None]) ** 2).sum(-1)
        return angle, (squared + ((self.centres[1] - self.centres[0]) / 2) ** 2).sqrt()

    def losses(self, raw: Tensor, wanted: Tensor, *, loss: Loss, beta: float) -> Tensor:
        nearest = (wanted[..., None] - self.centres).abs().argmin(-1)
        rows = nn.functional.cross_entropy(raw.flatten(0, -2), nearest.flatten(), reduction="none")
        return rows.reshape(wanted.shape)


HEADS: dict[HeadName, type[Head]] = {
    "regression": Head,
    "gaussian": Gaussian,
    "laplace": Laplace,
    "categorical": Categorical,
}
