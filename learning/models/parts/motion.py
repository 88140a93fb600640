"""Memories that measure how far the view moves to the side from frame to frame."""

import torch
from torch import Tensor, nn

from learning.models.parts.memory import LSTM, WINDOW, Extract, Memory

UPPER, HIGH = 0.6, 3  # part of the view, and rows that are averaged
FINE_PX = 160  # about as many columns are compared
REACH = 0.125  # of the width
FLOOR = 1e-4


class Standardisation(nn.BatchNorm1d):
    """Numbers (n, m) with mean 0 and deviation 1 by the statistics of all batches of the training so far.

    With those of the batch, as in batch normalisation, a number would depend on the other rows of its batch: their
    mean has the deviation 1/√n, 0.18 with 32 rows.
    """

    def __init__(self, numbers: int) -> None:
        super().__init__(numbers, affine=False, momentum=None)

    def forward(self, input: Tensor) -> Tensor:
        if self.training:
            super().forward(input)
        return nn.functional.batch_norm(input, self.running_mean, self.running_var, eps=self.eps)


class SideShift(nn.Module):
    """How far a view has moved to the side since another one.

    The edges p(y, x) of a view are the differences of its grey over the columns, in rows of the upper part, with
    deviation 1. The shift s has the least d(s) = mean (p(y, x) - p_before(y, x - s))² up to REACH of the width and
    is refined by a parabola; d is computed as mean p² + mean p_before² - 2·mean p·p_before.
    """

    places: Tensor

    def __init__(self, size: tuple[int, int]) -> None:
        super().__init__()
        self.width = size[1]
        self.finer = max(1, round(FINE_PX / size[1]))
        self.edges_size = (round(UPPER * size[0]) // HIGH, self.finer * size[1] - 2)
        self.edges_count = self.edges_size[0] * self.edges_size[1]
        self.reach = round(REACH * self.finer * size[1])
        inner = torch.arange(self.reach, self.edges_size[1] - self.reach)
        shifts = torch.arange(-self.reach, self.reach + 1)
        self.register_buffer("places", inner[None] - shifts[:, None], persistent=False)

    def edges(self, pixels: Tensor) -> Tensor:
        """The edges of views (n, c, h, w): (n, rows, columns)."""
        rows = HIGH * self.edges_size[0]
        grey = pixels.mean(dim=1)[:, :rows].unflatten(1, (-1, HIGH)).mean(dim=2)
        fine = nn.functional.interpolate(
            grey, size=self.finer * self.width, mode="linear", align_corners=False
        )
        edges = fine[..., 2:] - fine[..., :-2]
        return edges / ((edges**2).mean(dim=(1, 2), keepdim=True).sqrt() + FLOOR)

    def between(self, now: Tensor, before: Tensor) -> tuple[Tensor, Tensor]:
        """The shifts s/REACH (n,) and d(s)/mean d (n,) between edges (n, rows, columns)."""
        inner = now[:, :, self.reach : self.edges_size[1] - self.reach].transpose(1, 2)
        columns = before.transpose(1, 2)  # whole columns are copied
        products = columns[:, self.places].flatten(2) @ inner.flatten(1)[..., None]
        squares = (columns**2).sum(dim=2)[:, self.places].sum(dim=2) + (inner**2).sum(dim=(1, 2))[:, None]
        differences = (squares - 2 * products[..., 0]) / (inner.shape[1] * inner.shape[2])
        middle = differences[:, 1:-1].argmin(dim=-1, keepdim=True) + 1
        left, least, right = (differences.gather(-1, middle + i)[:, 0] for i in (-1, 0, 1))
        bend = (left - 2 * least + right).clamp(min=FLOOR)
        peak = (0.5 * (left - right) / bend).clamp(-1, 1)
        shift = (middle[:, 0] - self.reach + peak) / self.reach
        return shift, least / (differences.mean(dim=-1) + FLOOR)


class Shift(Memory):
    """How far the view has moved to the side between frames (:class:`SideShift`), over the last ``count`` frames.

    Output: the pixels flattened, then the last shifts s/REACH, and their d(s)/mean d, the newest first. The state
    holds a number that is 0 before the first frame, the edges of the frame before, and the older numbers of the
    output; the first frame has not moved. The head reads ``units`` numbers of the features and the shifts, and the
    shifts.
    """

    last_alone = True

    def __init__(self, size: tuple[int, int], count: int, units: int) -> None:
        super().__init__()
        self.size, self.count, self.in_a_row = size, count, count + 1
        self.motion = SideShift(size)
        self.moved = 2 * count
        self.state_size = 1 + self.motion.edges_count + self.moved
        self.scale = Standardisation(self.moved)
        self.join = nn.Sequential(nn.LazyLinear(units), nn.ReLU())

    def reads(self, pixels: Tensor, extract: Extract) -> Tensor:
        return pixels  # of a sequence, only those of the last frame go through the trunk

    def gives(self, output: Tensor, extract: Extract) -> Tensor:
        pixels = output[:, : -self.moved].unflatten(1, (-1, *self.size))
        moved = self.scale(output[:, -self.moved :])
        return torch.cat([self.join(torch.cat([extract(pixels), moved], dim=1)), moved], dim=1)

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        now = self.motion.edges(features)
        known, edges, older = state.split([1, self.motion.edges_count, self.moved], dim=1)
        before = torch.where(known[:, :, None] > 0.5, edges.unflatten(1, self.motion.edges_size), now)
        moved = torch.stack(self.motion.between(now, before), dim=1)
        moved = torch.cat([moved[..., None], older.unflatten(1, (2, -1))[..., :-1]], dim=2).flatten(1)
        state = torch.cat([torch.ones_like(known), now.flatten(1), moved], dim=1)
        return torch.cat([features.flatten(1), moved], dim=1), state

    def forward(self, features: Tensor) -> Tensor:
        """The output (n, o) of the last frame of sequences (n, t, c, h, w)."""
        last = features.shape[1] - 1
        places = [max(last - back, 0) for back in range(self.count + 1)]
        edges = self.motion.edges(features[:, places].flatten(0, 1)).unflatten(0, (-1, self.count + 1))
        pairs = self.motion.between(edges[:, :-1].flatten(0, 1), edges[:, 1:].flatten(0, 1))
        moved = [one.unflatten(0, (-1, self.count)) for one in pairs]
        return torch.cat([features[:, last].flatten(1), *moved], dim=1)


class ShiftedLSTM(Memory):
    """Long short-term memory of the features and of the shift of the view since the frame before.

    It reads the features of trunk and top, then the edges of the view (:class:`SideShift`); the output is that of
    the :class:`LSTM`, then the scaled shift and its d(s)/mean d. The state holds a number that is 0 before the
    first frame, the edges of the frame before, and the state of the LSTM.
    """

    in_a_row = 2

    def __init__(self, size: tuple[int, int], inputs: int, units: int) -> None:
        super().__init__()
        self.motion = SideShift(size)
        self.scale = Standardisation(2)
        self.lstm = LSTM(inputs + 2, units)
        self.remember(WINDOW)

    def remember(self, length: int) -> None:
        """Let an output depend on ``length`` frames."""
        self.lstm.remember(length)
        self.state_size = 1 + self.motion.edges_count + self.lstm.state_size

    def reads(self, pixels: Tensor, extract: Extract) -> Tensor:
        return torch.cat([extract(pixels), self.motion.edges(pixels).flatten(1)], dim=1)

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        seen, now = self._parts(features)
        known, before, inner = state.split([1, self.motion.edges_count, self.lstm.state_size], dim=1)
        moved = self._motion_input(now, torch.where(known > 0.5, before, now))
        output, inner = self.lstm.step(torch.cat([seen, moved], dim=1), inner)
        return torch.cat([output, moved], dim=1), torch.cat([torch.ones_like(known), now, inner], dim=1)

    def forward(self, features: Tensor) -> Tensor:
        """Outputs (n, t, o) of sequences (n, t, f) from a state of zeros."""
        seen, now = self._parts(features)
        before = torch.cat([now[:, :1], now[:, :-1]], dim=1)
        moved = self._motion_input(now.flatten(0, 1), before.flatten(0, 1)).unflatten(0, now.shape[:2])
        return torch.cat([self.lstm(torch.cat([seen, moved], dim=2)), moved], dim=2)

    def _parts(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """The features of trunk and top, and the edges."""
        edges = self.motion.edges_count
        return features[..., :-edges], features[..., -edges:]

    def _motion_input(self, now: Tensor, before: Tensor) -> Tensor:
        pairs = (edges.unflatten(1, self.motion.edges_size) for edges in (now, before))
        return self.scale(torch.stack(self.motion.between(*pairs), dim=1))
