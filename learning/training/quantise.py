"""A driving network with convolutions and large products of 8 bits, and its comparison with the one of 32 bits.

The scales of the activations come from training frames (static quantisation: Jacob et al., Quantization and
Training of Neural Networks for Efficient Integer-Arithmetic-Only Inference, CVPR 2018); each channel of the weights
has a scale of its own. Weights use 7 of the 8 bits, so that sums do not saturate on processors without VNNI.
"""

import hashlib
import json
import math
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from learning.dataset.dataset import Dataset
from learning.training.calibrate import COVERAGE, block_quantile, error_scores, speed_scores
from learning.training.export import METADATA, describe
from learning.training.frames import Frames, read_frames, share_of
from learning.unlike import OUTPUT, attach, detach
from perception.net.driver import DriverNetwork
from trepid.config import InputError
from trepid.files.whole import write_whole
from trepid.types import Floats, Image

CALIBRATED = 256  # training frames, evenly in time
LEAST_WEIGHTS = 4096  # of an operation of 8 bits
OPERATIONS = ("Conv", "Gemm", "MatMul")
TIMED = 300  # frames, by both networks in turn
LEAST_GAIN = 1.2  # in time per frame
MOST_ERROR = 1.02  # times the mean absolute error with 32 bits
ORIGIN = "quantised_from"  # in the metadata: sha256 of the file with 32 bits


class Comparison(NamedTuple):
    """Pairs with 32 and with 8 bits, on the validation frames, on one core."""

    mae_deg: tuple[float, float]
    frame_ms: tuple[float, float]  # medians; the networks take turns
    file_bytes: tuple[int, int]
    largest_change_deg: float  # of an angle

    @property
    def gain(self) -> float:
        """Time per frame with 32 bits : with 8 bits."""
        return self.frame_ms[0] / self.frame_ms[1]

    @property
    def pays(self) -> bool:
        """Whether 8 bits are faster by LEAST_GAIN with at most MOST_ERROR times the error."""
        return self.gain >= LEAST_GAIN and self.mae_deg[1] <= MOST_ERROR * self.mae_deg[0]


def quantise(source: Path, data: Dataset, out: Path, work: Path) -> Comparison:
    """Write ``out``, the network ``source`` with 8 bits, if that pays; the comparison.

    Scales and the world of ``unlike`` come from the training frames of ``data``, interval and scores from its
    validation frames. ``work`` is a folder for files of the calculation. Raises InputError for a file that is no
    driving network, has a memory or 8 bits already, or was trained on another data set.
    """
    network = DriverNetwork(source)
    metadata = _metadata(source, network, data)
    size = dict(height=network.record.height, width=network.record.width)
    train, validation = (
        read_frames(data, split, **size, folder=work, report=lambda _: None)
        for split in ("train", "validation")
    )
    small = work / "int8.onnx"
    _convert(source, small, train)
    attach(small, train.images, others=validation.images)
    describe(small, metadata)
    before, after = _outputs(network, validation), _outputs(DriverNetwork(small), validation)
    ratios = np.abs(after[0] - validation.labels_rad) / after[1]
    scores = error_scores(after[0], validation.labels_rad) | speed_scores(after[2], train, validation)
    describe(small, metadata | dict(interval_90=block_quantile(ratios, COVERAGE), scores=scores))
    found = Comparison(
        mae_deg=(error_scores(before[0], validation.labels_rad)["mae_deg"], scores["mae_deg"]),
        frame_ms=_times_ms(network, DriverNetwork(small), validation.images),
        file_bytes=(source.stat().st_size, small.stat().st_size),
        largest_change_deg=math.degrees(float(np.abs(after[0] - before[0]).max())),
    )
    if found.pays:
        write_whole(out, small.read_bytes())
    return found


def _metadata(source: Path, network: DriverNetwork, data: Dataset) -> dict[str, Any]:
    """The metadata of ``source`` and its sha256. Raises InputError where it cannot be converted."""
    import onnx

    if network.initial_state is not None:
        raise InputError(f"{source}: has a memory; only networks of one frame are converted to 8 bits")
    known = network.record.data_sha256
    if known != data.sha256:
        raise InputError(
            f"{source}: was trained on a data set with sha256 {known[:12] or '(not stated)'}, {data.folder} has"
            f" {data.sha256[:12]}"
        )
    props = onnx.load(source).metadata_props
    metadata: dict[str, Any] = json.loads(next(prop.value for prop in props if prop.key == METADATA))
    if ORIGIN in metadata:
        raise InputError(f"{source}: has 8 bits already")
    return metadata | {ORIGIN: hashlib.sha256(source.read_bytes()).hexdigest()}


def _convert(source: Path, small: Path, train: Frames) -> None:
    """Write ``small``: ``source`` without its world, its large operations with 8 bits."""
    import onnx
    from onnxruntime.quantization import CalibrationDataReader, QuantFormat, QuantType, quantize_static
    from onnxruntime.quantization.shape_inference import quant_pre_process

    class Reader(CalibrationDataReader):
        """Frames of the training, one after the other."""

        def __init__(self) -> None:
            places = share_of(len(train), min(1.0, CALIBRATED / len(train)))
            self._images: Iterator[Image] = (train.images[place][None] for place in places)

        def get_next(self) -> dict[str, Image] | None:
            image = next(self._images, None)
            return None if image is None else {"image": image}

    model = onnx.load(source)
    detach(model, OUTPUT)
    bare, prepared = small.with_name("bare.onnx"), small.with_name("prepared.onnx")
    onnx.save(model, bare)
    quant_pre_process(str(bare), str(prepared), skip_symbolic_shape=True)
    graph = onnx.load(prepared).graph
    weights = {one.name: math.prod(one.dims) for one in graph.initializer}
    little = [
        node.name
        for node in graph.node
        if node.op_type in OPERATIONS and max(weights.get(name, 0) for name in node.input) < LEAST_WEIGHTS
    ]
    quantize_static(
        str(prepared),
        str(small),
        Reader(),
        quant_format=QuantFormat.QDQ,
        op_types_to_quantize=[*OPERATIONS],
        nodes_to_exclude=little,
        activation_type=QuantType.QUInt8,
        weight_type=QuantType.QInt8,
        per_channel=True,
        reduce_range=True,
    )


def _outputs(network: DriverNetwork, frames: Frames) -> tuple[Floats, Floats, Floats]:
    """Angles and scales of the errors [rad], and speeds [m/s], NaN without one, each (n,)."""
    found = [network(image, None) for image in frames.images]
    speeds_mps = [np.nan if one.speed_mps is None else one.speed_mps for one in found]
    return (
        np.array([one.road_wheel_rad for one in found]),
        np.array([one.scale_rad for one in found]),
        np.array(speeds_mps),
    )


def _times_ms(before: DriverNetwork, after: DriverNetwork, images: Image) -> tuple[float, float]:
    """Medians of the time per frame; for each image both networks, one after the other."""
    taken_ms: tuple[list[float], list[float]] = ([], [])
    for number in range(TIMED):
        for network, times in zip((before, after), taken_ms, strict=True):
            began_s = time.perf_counter()
            network(images[number % len(images)], None)
            times.append(1e3 * (time.perf_counter() - began_s))
    return median(taken_ms[0]), median(taken_ms[1])
