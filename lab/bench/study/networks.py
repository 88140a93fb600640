"""Depth and memory of networks that steer, at equal epochs and frames (N03, N05, N16).

*Depth.* The review cites networks of one to 48 layers on different frames. Here the first convolutions of one
network, :data:`learning.models.papers.CNN_LSTM`, learn the same frames.

*Memory.* A network of one frame beside the same with a long short-term memory, and the top of Deep Steer as
printed, with sequences of length 1, beside the same on true sequences. The top is the paper's; its trunk is the
small one, because InceptionV3 does not train on two cores in an hour. The rates of the angles say how quiet a
wheel is.

The frames are those of :mod:`lab.bench.study.passages`, every fourth, half of them mirrored, so that WINDOW of
them span a passage.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.bench.study.optimisers import EVERY, HEIGHT_PX, WIDTH_PX, frames_of
from lab.bench.study.passages import (
    Passages,
    every_nth,
    mean_row,
    rate_rms_degps,
    stages,
    straight_deg,
    train_passages,
)
from learning.rendered import need_torch

if TYPE_CHECKING:
    from learning.models.parts.network import SteeringNetwork

Row = dict[str, Any]
EPOCHS, RATE, SEEDS = 16, 1.0e-3, 3
WINDOW, BATCH = 8, 16  # frames
DENSE, UNITS = (100, 50), 128


def bench_networks(seed: int) -> Row:
    """Errors of the road wheel on roads that were not learned from, by depth and by memory."""
    need_torch("bench study networks")
    frames = frames_of(seed)
    frames = frames._replace(test=every_nth(frames.test, EVERY))
    tables = {
        title: {
            name: mean_row([row_of(frames, make, seed + n) for n in range(SEEDS)])
            for name, make in rows.items()
        }
        for title, rows in (("convolutions", by_depth()), ("memory", by_memory()))
    }
    return tables | {
        "always straight [deg]": round(straight_deg(frames.test), 3),
        "rate of the true angles [deg/s]": round(
            rate_rms_degps(frames.test.labels_rad, frames.test) / EVERY, 3
        ),
        "frames": len(frames.train),
        "epochs": EPOCHS,
        "seeds": SEEDS,
    }


def row_of(frames: Passages, make: Callable[[], "SteeringNetwork"], seed: int) -> Row:
    """The scores of a training."""
    import torch

    from learning.training.loop import predict

    torch.manual_seed(seed)
    network = make()
    sequences = network.memory is not None
    changes = {
        **stages(EPOCHS, RATE),
        "seed": str(seed),
        "average": "0",
        "batch": str(BATCH // WINDOW if sequences else BATCH),
        "window": str(WINDOW),
        "initialisation": "glorot",
        "augmentation.flip": "0.5",
    }
    network, progress = train_passages(frames, "cnn-lstm", changes, network)
    angles_rad, _ = predict(network, frames.test)
    found = np.degrees(angles_rad.astype(float) - frames.test.labels_rad)
    return {
        "mae_deg": float(np.abs(found).mean()),
        "rmse_deg": float(np.sqrt(np.mean(found**2))),
        "rate_rms_degps": rate_rms_degps(angles_rad, frames.test) / EVERY,
        "rate_error_rms_degps": rate_rms_degps(np.radians(found), frames.test) / EVERY,
        "weights": float(network.parameters_count),
        "seconds": progress.elapsed_s,
    }


def by_depth() -> dict[str, Callable[[], "SteeringNetwork"]]:
    """Number of convolutions -> the network."""
    from learning.models.papers import CNN_LSTM

    return {f"{count}": lambda count=count: small(count) for count in range(1, len(CNN_LSTM) + 1)}  # type: ignore[misc]


def by_memory() -> dict[str, Callable[[], "SteeringNetwork"]]:
    """Kind of memory -> the network."""
    from learning.models.catalogue import build
    from learning.models.deep_steer import DENSE as FEATURES
    from learning.models.deep_steer import WithoutPast
    from learning.models.parts.memory import SimpleRNN

    return {
        "one frame": small,
        "one frame, LSTM": lambda: build("cnn-lstm", height=HEIGHT_PX, width=WIDTH_PX),
        "top of Deep Steer": deep_steer_top,
        "top of Deep Steer, RNN of length 1": lambda: deep_steer_top(
            last=WithoutPast(SimpleRNN(FEATURES, UNITS))
        ),
        "top of Deep Steer, RNN of a sequence": lambda: deep_steer_top(memory=SimpleRNN(FEATURES, UNITS)),
    }


def small(convolutions_count: int | None = None) -> "SteeringNetwork":
    """The first convolutions, and the dense layers of ``cnn-lstm``."""
    from learning.models.papers import CNN_LSTM
    from learning.models.parts.heads import HEADS
    from learning.models.parts.network import Size, SteeringNetwork, convolutions, dense
    from learning.models.parts.view import InputView

    trunk = convolutions(3, CNN_LSTM[:convolutions_count], norm=True, same=True)
    size = Size(HEIGHT_PX, WIDTH_PX)
    return SteeringNetwork(size, InputView(scaling="contrast"), trunk, dense(*DENSE), HEADS["regression"]())


def deep_steer_top(**parts: Any) -> "SteeringNetwork":
    """The small trunk under the top of Deep Steer, with ``last`` or ``memory`` of :func:`with_top`."""
    from learning.models.deep_steer import with_top
    from learning.models.papers import CNN_LSTM
    from learning.models.parts.heads import HEADS
    from learning.models.parts.network import Size, convolutions
    from learning.models.parts.view import InputView

    trunk = convolutions(3, CNN_LSTM, norm=True, same=True)
    view = InputView(scaling="contrast")
    return with_top(Size(HEIGHT_PX, WIDTH_PX), HEADS["regression"](), trunk, view, **parts)
