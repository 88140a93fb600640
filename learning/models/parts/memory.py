"""Layers with one state tensor, so that the state can be an input and an output of a graph."""

import torch
from torch import Tensor, nn

UPPER, HIGH = 0.6, 3  # part of the view, and rows that are averaged
FINE_PX = 160  # about as many columns are compared
REACH = 0.125  # of the width
FLOOR = 1e-4


class Memory(nn.Module):
    """A recurrent layer. ``step``: (features (n, f), state (n, s)) -> (output (n, o), next state (n, s))."""

    state_size: int

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        raise NotImplementedError

    def forward(self, features: Tensor) -> Tensor:
        """Outputs (n, t, o) of sequences (n, t, f) from a state of zeros."""
        state = features.new_zeros(features.shape[0], self.state_size)
        outputs = []
        for t in range(features.shape[1]):
            output, state = self.step(features[:, t], state)
            outputs.append(output)
        return torch.stack(outputs, dim=1)


class SimpleRNN(Memory):
    """h' = tanh(W·x + U·h + b), Keras' SimpleRNN: units·(inputs + units + 1) weights."""

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.state_size = units
        self.input = nn.Linear(inputs, units)
        self.recurrent = nn.Linear(units, units, bias=False)
        nn.init.orthogonal_(self.recurrent.weight)

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        output = torch.tanh(self.input(features) + self.recurrent(state))
        return output, output


class LSTM(Memory):
    """Long short-term memory (Hochreiter and Schmidhuber, 1997): 4·units·(inputs + units + 1) weights.

    The state holds output and cell. Gates i, f, g, o come from one linear layer of (features, output); the forget
    gate starts open (bias 1).
    """

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.state_size = 2 * units
        self.gates = nn.Linear(inputs + units, 4 * units)
        with torch.no_grad():
            self.gates.bias[units : 2 * units] = 1.0

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        output, cell = state.chunk(2, dim=1)
        i, f, g, o = self.gates(torch.cat([features, output], dim=1)).chunk(4, dim=1)
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
        output = torch.sigmoid(o) * torch.tanh(cell)
        return output, torch.cat([output, cell], dim=1)


class Shift(Memory):
    """How far the view has moved to the side from frame to frame, over the last ``count`` frames.

    The edges p(y, x) of a view are the differences of its grey over the columns, in rows of the upper part, with
    deviation 1. The shift s since the frame before has the least d(s) = mean (p(y, x) - p_before(y, x - s))² up to
    REACH of the width and is refined by a parabola; d is computed as mean p² + mean p_before² - 2·mean p·p_before.
    Output: the pixels flattened, then the last s/REACH, and their d(s)/mean d, the newest first. The state holds a
    number that is 0 before the first frame, the edges of the frame before, and the older numbers of the output; the
    first frame has not moved.
    """

    places: Tensor

    def __init__(self, size: tuple[int, int], count: int, units: int) -> None:
        """``join`` makes ``units`` of the features of a trunk and the shifts."""
        super().__init__()
        self.size, self.count = size, count
        self.finer = max(1, round(FINE_PX / size[1]))
        self.edges_size = (round(UPPER * size[0]) // HIGH, self.finer * size[1] - 2)
        self.edges_count, self.moved = self.edges_size[0] * self.edges_size[1], 2 * count
        self.state_size = 1 + self.edges_count + self.moved
        self.reach = round(REACH * self.finer * size[1])
        inner = torch.arange(self.reach, self.edges_size[1] - self.reach)
        shifts = torch.arange(-self.reach, self.reach + 1)
        self.register_buffer("places", inner[None] - shifts[:, None], persistent=False)
        self.scale = nn.BatchNorm1d(self.moved, affine=False)
        self.join = nn.Sequential(nn.LazyLinear(units), nn.ReLU())

    def edges(self, pixels: Tensor) -> Tensor:
        """The edges of views (n, c, h, w): (n, rows, columns)."""
        rows = HIGH * self.edges_size[0]
        grey = pixels.mean(dim=1)[:, :rows].unflatten(1, (-1, HIGH)).mean(dim=2)
        fine = nn.functional.interpolate(
            grey, size=self.finer * self.size[1], mode="linear", align_corners=False
        )
        edges = fine[..., 2:] - fine[..., :-2]
        return edges / ((edges**2).mean(dim=(1, 2), keepdim=True).sqrt() + FLOOR)

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        now = self.edges(features)
        known, edges, older = state.split([1, self.edges_count, self.moved], dim=1)
        before = torch.where(known[:, :, None] > 0.5, edges.unflatten(1, self.edges_size), now)
        moved = torch.stack(self.between(now, before), dim=1)
        moved = torch.cat([moved[..., None], older.unflatten(1, (2, -1))[..., :-1]], dim=2).flatten(1)
        state = torch.cat([torch.ones_like(known), now.flatten(1), moved], dim=1)
        return torch.cat([features.flatten(1), moved], dim=1), state

    def forward(self, features: Tensor) -> Tensor:
        """The output (n, o) of the last frame of sequences (n, t, c, h, w)."""
        last = features.shape[1] - 1
        places = [max(last - back, 0) for back in range(self.count + 1)]
        edges = self.edges(features[:, places].flatten(0, 1)).unflatten(0, (-1, self.count + 1))
        pairs = self.between(edges[:, :-1].flatten(0, 1), edges[:, 1:].flatten(0, 1))
        moved = [one.unflatten(0, (-1, self.count)) for one in pairs]
        return torch.cat([features[:, last].flatten(1), *moved], dim=1)

    def parts(self, output: Tensor) -> tuple[Tensor, Tensor]:
        """Pixels (n, c, h, w), and scaled shifts and differences (n, m), of an output."""
        pixels = output[:, : -self.moved].unflatten(1, (-1, *self.size))
        return pixels, self.scale(output[:, -self.moved :])

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
