"""The networks of the study differ in depth or memory alone, and learn the same frames as often."""

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from torch import nn

from lab.bench.study import networks
from lab.bench.study.networks import WINDOW, by_depth, by_memory, row_of
from lab.bench.study.passages import Passages, every_nth, rate_rms_degps, resize
from learning.training.frames import Frames


def frames(passages: int, seed: int) -> Frames:
    """Frames whose left half is the brighter, the further the angle is to the left."""
    rng = np.random.default_rng(seed)
    stretches = np.repeat(np.arange(passages, dtype=np.int32), WINDOW)
    labels = rng.uniform(-0.1, 0.1, len(stretches)).astype(np.float32)
    images = np.full((len(labels), 48, 96, 3), 100, np.uint8)
    images[:, :, :48] += (400 * labels).astype(np.int8).astype(np.uint8)[:, None, None, None]
    small = Frames(images, labels, stretches, stretches.astype(np.int64), ("passages",))
    return resize(small, networks.HEIGHT_PX, networks.WIDTH_PX)


def test_every_nth_frame_keeps_its_label_and_its_speed():
    numbers = np.arange(10)
    images = np.zeros((10, 2, 2, 3), np.uint8)
    speeds_mps = numbers.astype(np.float32)
    frames = Frames(images, speeds_mps / 10, numbers, numbers, ("drive",), speeds_mps)
    kept = every_nth(frames, 4)
    assert kept.speeds_mps is not None
    assert kept.labels_rad.tolist() == pytest.approx([0.0, 0.4, 0.8]) and kept.speeds_mps.tolist() == [
        0,
        4,
        8,
    ]


def test_deeper_networks_have_one_convolution_more_each():
    count = [sum(isinstance(layer, nn.Conv2d) for layer in make().modules()) for make in by_depth().values()]
    assert count == [1, 2, 3, 4, 5, 6] and [str(one) for one in count] == list(by_depth())


def test_the_two_recurrent_tops_have_the_same_weights_and_one_of_them_a_memory():
    made = {name: make() for name, make in by_memory().items()}
    printed, sequence = (made[f"top of Deep Steer, RNN of {kind}"] for kind in ("length 1", "a sequence"))
    assert printed.parameters_count == sequence.parameters_count
    assert printed.memory is None and sequence.memory is not None


def test_a_network_learns_what_the_frames_show_and_its_scores_are_those_of_its_angles(monkeypatch):
    monkeypatch.setattr(networks, "EPOCHS", 12)
    seen = Passages(frames(12, 1), frames(3, 2), frames(4, 3))
    for make in (by_depth()["1"], by_memory()["one frame, LSTM"]):
        row = row_of(seen, make, 1)
        assert row["mae_deg"] < np.degrees(np.abs(seen.test.labels_rad)).mean()
        assert row["rmse_deg"] >= row["mae_deg"] > 0 and row["rate_rms_degps"] > 0


def test_the_rate_of_angles_leaves_out_the_step_from_one_passage_to_the_next():
    one = frames(2, 4)
    angles = np.where(one.stretches == 0, 0.0, 1.0)
    assert rate_rms_degps(angles, one) == 0.0
    assert rate_rms_degps(np.arange(2 * WINDOW) * np.radians(0.04), one) == pytest.approx(1.0)
