"""Recurrent layers with one state tensor, so that the state can be an input and an output of a graph."""

import torch
from torch import Tensor, nn


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
