"""Labels for the training alone: aligned with the images, and without the jerks of the hand that held the stick.

Validation and test keep the recorded labels. Weights even out the distribution of angles: straight roads fill most
recordings.
"""

from itertools import pairwise

import numpy as np

from learning.dataset.dataset import Dataset, Rows, pieces_of
from learning.dataset.motion import delay_of
from learning.training.recipe import Recipe
from trepid.config import InputError
from trepid.recording.interpolation import GAP_S
from trepid.types import Column, Floats

REACH = 4.0  # standard deviations


def training_labels(data: Dataset, recipe: Recipe) -> Floats:
    """Labels (n,) [rad] of the training frames, by ``label_delay_s`` and ``label_smoothing_s`` of the recipe.

    Raises InputError where the delay is to be measured and cannot be.
    """
    rows = data.rows("train")
    rows = rows[np.isfinite(rows["road_wheel_rad"])]
    delay_s = recipe.label_delay_s
    if delay_s == "measured":
        delay_s = measured_delay_s(data)
    return treat_labels(rows, delay_s=delay_s, smoothing_s=recipe.label_smoothing_s).astype(np.float32)


def measured_delay_s(data: Dataset) -> float:
    """How long after the image that shows its effect a label was recorded [s], in the training frames.

    Measured by the motion of the car. Raises InputError where label and motion are not related.
    """
    found = delay_of(data.rows("train")).delay_s
    if found is None:
        raise InputError(f"{data.folder}: label_delay_s: the labels are not related to the motion of the car")
    return -found


def treat_labels(rows: Rows, *, delay_s: float, smoothing_s: float) -> Column:
    """The labels of ``rows``, taken ``delay_s`` after each, as the mean under a normal curve of ``smoothing_s``.

    label'(t) = Σ_k w(t_k - t - delay)·label(t_k)/Σ_k w over the rows k of a part, w(x) = exp(-x²/2s²): without
    phase. Without smoothing, and where no label is within REACH, label(t + delay) is interpolated. A part ends with
    its stretch, and where rows of more than GAP_S were left out; at its ends the nearest labels count.
    """
    found = np.empty(len(rows))
    near = (np.diff(rows["stretch"]) == 0) & (np.diff(rows["t_s"]) <= GAP_S)
    borders = np.flatnonzero((np.diff(pieces_of(rows)) > 0) & ~near) + 1
    for first, end in pairwise([0, *borders.tolist(), len(rows)]):
        t_s, label = rows["t_s"][first:end], rows["road_wheel_rad"][first:end]
        at_s = np.clip(t_s + delay_s, t_s[0], t_s[-1])
        found[first:end] = (
            smooth(t_s, label, at_s, smoothing_s) if smoothing_s else np.interp(at_s, t_s, label)
        )
    return found


def smooth(t_s: Column, label: Column, at_s: Column, smoothing_s: float) -> Column:
    """The mean of ``label`` (n,), recorded at ``t_s``, under a normal curve about each ``at_s``.

    Interpolated where no label is within REACH.
    """
    low, high = (np.searchsorted(t_s, at_s + side * REACH * smoothing_s) for side in (-1.0, 1.0))
    found = np.interp(at_s, t_s, label)
    for number, (first, end, middle_s) in enumerate(zip(low, high, at_s, strict=True)):
        if first < end:
            weight = np.exp(-0.5 * ((t_s[first:end] - middle_s) / smoothing_s) ** 2)
            found[number] = weight @ label[first:end] / weight.sum()
    return found


BINS = 21
LARGEST = 10.0  # so that a few rare frames do not fill an epoch


def weights(
    road_wheel_rad: Column, *, bins: int = BINS, power: float = 0.5, largest: float = LARGEST
) -> Column:
    """A weight for each label, of mean 1: (1/count of its bin)^``power``, at most ``largest`` times the least.

    ``power`` 0 leaves the distribution as it is, 1 makes it even. The bins are equal parts of the range up to the
    99.9th percentile of abs(label); labels must be finite.
    """
    if not len(road_wheel_rad):
        return np.empty(0)
    most = float(np.percentile(np.abs(road_wheel_rad), 99.9)) or 1.0
    place = np.clip(((road_wheel_rad / most + 1.0) / 2.0 * bins).astype(int), 0, bins - 1)
    count = np.bincount(place, minlength=bins)
    weight = np.maximum(count, 1)[place] ** -power
    weight = np.minimum(weight, largest * weight.min())
    return np.asarray(weight / weight.mean())
