"""Layers with one state tensor, so that the state can be an input and an output of a graph."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

WINDOW = 8  # frames of an untrained memory


Extract = Callable[[Tensor], Tensor]
"""Pixels (n, c, h, w) to features (n, f): trunk and top of a network."""


class Memory(nn.Module):
    """A recurrent layer. ``step``: (features (n, f), state (n, s)) -> (output (n, o), next state (n, s))."""

    state_size: int
    last_alone = False  # whether ``forward`` gives the output of the last frame of a sequence alone
    in_a_row = 1  # frames that a window has to hold one after the other

    def remember(self, length: int) -> None:
        """Let an output depend on ``length`` frames, where the memory is one of the last frames."""

    def reads(self, pixels: Tensor, extract: Extract) -> Tensor:
        """The features for ``step``."""
        return extract(pixels)

    def gives(self, output: Tensor, extract: Extract) -> Tensor:
        """The features for the head, of outputs of ``step``."""
        return output

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

    Gates i, f, g, o come from one linear layer of (features, output); the forget gate starts open (bias 1). The
    state holds the features of the last frames, and each output is that of the last :attr:`length` frames after a
    cell of zeros, as in the windows of a training: a cell that is carried on adds up frame by frame, and leaves the
    range of those windows.
    """

    length: int

    def __init__(self, inputs: int, units: int) -> None:
        super().__init__()
        self.inputs, self.units = inputs, units
        self.gates = nn.Linear(inputs + units, 4 * units)
        with torch.no_grad():
            self.gates.bias[units : 2 * units] = 1.0
        self.remember(WINDOW)

    def remember(self, length: int) -> None:
        """Let an output depend on ``length`` frames."""
        self.length = length
        self.state_size = length * (1 + self.inputs)  # of each frame whether there was one, and its features

    def step(self, features: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        one = torch.ones_like(state[:, :1])  # of the state, whose size in a graph is free
        state = torch.cat([state[:, 1 + self.inputs :], one, features], dim=1)
        output = cell = torch.zeros_like(one).expand(-1, self.units)
        for frame in state.chunk(self.length, dim=1):
            known, seen = frame[:, :1], frame[:, 1:]
            output, cell = (known * value for value in self._next(seen, output, cell))
        return output, state

    def forward(self, features: Tensor) -> Tensor:
        """Outputs (n, t, o) of sequences (n, t, f) from a cell of zeros, t up to :attr:`length`."""
        output = cell = features.new_zeros(features.shape[0], self.units)
        outputs = []
        for seen in features.unbind(1):
            output, cell = self._next(seen, output, cell)
            outputs.append(output)
        return torch.stack(outputs, dim=1)

    def _next(self, features: Tensor, output: Tensor, cell: Tensor) -> tuple[Tensor, Tensor]:
        i, f, g, o = self.gates(torch.cat([features, output], dim=1)).chunk(4, dim=1)
        cell = torch.sigmoid(f) * cell + torch.sigmoid(i) * torch.tanh(g)
        return torch.sigmoid(o) * torch.tanh(cell), cell
