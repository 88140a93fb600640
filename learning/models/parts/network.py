"""A driving network: view, trunk, top, perhaps a memory, head; perhaps a second output, a speed."""

from collections.abc import Iterator
from typing import NamedTuple

import torch
from torch import Tensor, nn

from learning.models.parts.heads import Head
from learning.models.parts.memory import Memory
from learning.models.parts.view import InputView
from trepid.config import InputError


class Size(NamedTuple):
    """Rows and columns of the frames that a network reads."""

    height: int
    width: int


class SteeringNetwork(nn.Module):
    """Frames to rows of the head; ``scale_rad`` [rad] is the unit of its angles.

    ``trunk``: image features, frozen in the first stage of a transfer; ``top``: a vector (n, f) of them. The memory
    stands between top and head; some of them read the view too.
    """

    scale_rad: Tensor

    def __init__(
        self,
        size: Size,
        view: InputView,
        trunk: nn.Module,
        top: nn.Module,
        head: Head,
        memory: Memory | None = None,
    ) -> None:
        """Raises InputError when frames of ``size`` are too small for the layers."""
        super().__init__()
        self.size, self.view, self.trunk, self.top, self.head, self.memory = (
            size,
            view,
            trunk,
            top,
            head,
            memory,
        )
        self.stride = 1  # the memory reads every so-manieth frame
        self.speed: SpeedOutput | None = None
        self.register_buffer("scale_rad", torch.tensor(1.0))
        shape = (1, *size, 3) if memory is None else (1, 1, *size, 3)
        try:
            with torch.no_grad():
                self.eval()(torch.zeros(shape, dtype=torch.uint8))  # gives lazy layers their sizes
        except RuntimeError as error:
            raise InputError(
                f"frames of {size.width}x{size.height} px are too small for the layers of this network"
            ) from error
        self.train()

    @property
    def parameters_count(self) -> int:
        return sum(p.numel() for p in self.parameters())

    def add_speed(self, mean_mps: float, spread_mps: float) -> None:
        """Give the network a second output, of speeds with this mean and deviation."""
        self.speed = SpeedOutput(self.head.linear.in_features, mean_mps, spread_mps)

    def before_memory(self, image: Tensor) -> Tensor:
        """What the memory, or else the head, reads of uint8 BGR frames (n, H, W, 3)."""
        pixels = self.view(image)
        return self.extract(pixels) if self.memory is None else self.memory.reads(pixels, self.extract)

    def after_memory(self, output: Tensor) -> Tensor:
        """Rows (…, o) of the head, of outputs of the memory; a last column is that of the speed."""
        features = output if self.memory is None else self.memory.gives(output, self.extract)
        rows: Tensor = self.head(features)
        return rows if self.speed is None else torch.cat([rows, self.speed(features)], dim=-1)

    def steering(self, raw: Tensor) -> Tensor:
        """The columns of the head."""
        return raw[..., : self.head.size]

    def extract(self, pixels: Tensor) -> Tensor:
        """Features (n, f) of pixels (n, c, h, w)."""
        features: Tensor = self.top(self.trunk(pixels))
        return features

    def forward(self, image: Tensor) -> Tensor:
        """Rows (n, o) of frames (n, H, W, 3); with a memory rows (n, t, o) of sequences (n, t, H, W, 3).

        Where the memory gives the last frame alone, (n, 1, o).
        """
        if self.memory is None:
            return self.after_memory(self.before_memory(image))
        output = self.memory(self.before_memory(image.flatten(0, 1)).unflatten(0, image.shape[:2]))
        rows = self.after_memory(output)
        return rows[:, None] if self.memory.last_alone else rows

    def angle(self, raw: Tensor) -> tuple[Tensor, Tensor]:
        """Road-wheel angle and standard deviation of its error [rad], of rows of the head."""
        angle, sigma = self.head.angle(self.steering(raw))
        return angle * self.scale_rad, sigma * self.scale_rad


class SpeedOutput(nn.Module):
    """A linear layer of the features of the head: the speed of the driver, v = mean + deviation·y."""

    mean_mps: Tensor
    spread_mps: Tensor

    def __init__(self, inputs: int, mean_mps: float, spread_mps: float) -> None:
        super().__init__()
        self.linear = nn.Linear(inputs, 1)
        self.register_buffer("mean_mps", torch.tensor(mean_mps))
        self.register_buffer("spread_mps", torch.tensor(spread_mps))

    def forward(self, features: Tensor) -> Tensor:
        """y (…, 1), of features (…, f)."""
        y: Tensor = self.linear(features)
        return y

    def speed_mps(self, raw: Tensor) -> Tensor:
        """The speeds [m/s] of rows (…, o) of a network, whose last column is y."""
        return self.mean_mps + self.spread_mps * raw[..., -1]

    def loss(self, raw: Tensor, speeds_mps: Tensor) -> Tensor:
        """The mean of (y - (v - mean)/deviation)² over the known speeds v; 0 where none is known.

        A speed that is not recorded, NaN, has no part in the loss and in its gradient.
        """
        known = torch.isfinite(speeds_mps)
        y = raw[..., -1]
        wanted = torch.where(known, (speeds_mps - self.mean_mps) / self.spread_mps, y.detach())
        return ((y - wanted) ** 2).sum() / known.sum().clamp(min=1)


class ExportedNetwork(nn.Module):
    """Frames (n, H, W, 3) to the outputs :attr:`names`: angle and sigma [rad], perhaps a speed [m/s], (n,) each.

    With a memory also state to next state.
    """

    def __init__(self, network: SteeringNetwork) -> None:
        super().__init__()
        self.network = network
        self.names = (
            *("road_wheel_rad", "sigma_rad"),
            *([] if network.speed is None else ["speed_mps"]),
            *([] if network.memory is None else ["next_state"]),
        )

    def forward(self, image: Tensor, state: Tensor | None = None) -> tuple[Tensor, ...]:
        features = self.network.before_memory(image)
        if self.network.memory is None or state is None:
            return self._outputs(features)
        output, state = self.network.memory.step(features, state)
        return *self._outputs(output), state

    def _outputs(self, output: Tensor) -> tuple[Tensor, ...]:
        raw = self.network.after_memory(output)
        speed = () if self.network.speed is None else (self.network.speed.speed_mps(raw),)
        return *self.network.angle(raw), *speed


def convolutions(
    before: int,
    layers: tuple[tuple[int, int, int], ...],
    *,
    dropout: float = 0.0,
    norm: bool = False,
    same: bool = False,
) -> nn.Sequential:
    """Convolutions (channels, kernel, stride), each with a ReLU; ``same``: padded by half a kernel."""
    built: list[nn.Module] = []
    for channels, kernel, stride in layers:
        built.append(nn.Conv2d(before, channels, kernel, stride, kernel // 2 if same else 0, bias=not norm))
        if norm:
            built.append(nn.BatchNorm2d(channels))
        built.append(nn.ReLU())
        if dropout:
            built.append(nn.Dropout(dropout))
        before = channels
    return nn.Sequential(*built)


def dense(*units: int, dropout: float = 0.0) -> nn.Sequential:
    """Flattened input, then dense layers of ``units``, each with a ReLU."""
    built: list[nn.Module] = [nn.Flatten()]
    for count in units:
        built += [nn.LazyLinear(count), nn.ReLU()]
        if dropout:
            built.append(nn.Dropout(dropout))
    return nn.Sequential(*built)


def glorot(network: nn.Module) -> None:
    """Weights as Keras starts them: Glorot uniform, biases zero. Batch normalisation and memories keep theirs."""
    for layer in _layers_with_weights(network):
        nn.init.xavier_uniform_(layer.weight)
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)


def he(network: nn.Module) -> None:
    """Weights after He et al. (ICCV 2015), for ReLU; biases zero. Batch normalisation and memories keep theirs."""
    for layer in _layers_with_weights(network):
        nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
        if layer.bias is not None:
            nn.init.zeros_(layer.bias)


def _layers_with_weights(part: nn.Module) -> Iterator[nn.Conv2d | nn.Linear]:
    """The convolutions and dense layers of a network that are no part of its memory."""
    for layer in part.children():
        if isinstance(layer, nn.Conv2d | nn.Linear):
            yield layer
        elif not isinstance(layer, Memory):
            yield from _layers_with_weights(layer)
