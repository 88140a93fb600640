"""Predictions of the recorded angles that need no image, and what a comparison with them says about learning.

A network can have a small error and have learned nothing: on a straight road every constant is right, and where the
angle changes slowly the angle of a moment ago is. The sentences here say so beside the score.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import Dataset, Rows, middle_rows
from learning.dataset.split import without_steering
from learning.judging.scores import Angles, Scores
from trepid.types import Floats

AGO_S = 0.2
STRAIGHT, MEAN, PREVIOUS = "always_straight", "mean", "previous_200ms"
CONSTANTS = {STRAIGHT: "straight ahead", MEAN: "the mean angle of the training"}
Flags = NDArray[np.bool_]


def previous(angles: Angles, t_s: Angles, stretch: NDArray[np.int64], *, ago_s: float = AGO_S) -> Angles:
    """The newest angle of the same stretch that is at least ``ago_s`` old at each frame; NaN without one.

    Frames are in the order of stretches and time. A delay of 0.2 s is about that of a driver, so that this baseline
    has seen the driver steer; an image model has not.
    """
    found = np.full(len(angles), np.nan)
    for number in np.unique(stretch):
        (inside,) = np.nonzero(stretch == number)
        at = np.searchsorted(t_s[inside], t_s[inside] - ago_s + 1e-6, side="right") - 1
        known = at >= 0
        found[inside[known]] = angles[inside[at[known]]]
    return found


@dataclass(frozen=True, slots=True)
class LearningDoubt:
    """A reason why a score does not show learning: ``finding`` for programs, ``sentence`` for readers."""

    finding: str
    sentence: str


@dataclass(frozen=True, slots=True)
class Learning:
    """What the error of a model beside the baselines says."""

    findings: tuple[LearningDoubt, ...]
    conclusion: str


class Baselines:
    """The recorded angles of a split, and predictions of them that need no image, [rad] of the road wheel.

    Side cameras have no recorded angles, and are not judged.
    """

    def __init__(self, dataset: Dataset, split: str, *, trained: Dataset | None = None) -> None:
        """``trained``: the data set whose training frames have the angle of the baseline "mean", if it is another.

        Raises InputError for an unknown split and for one without labelled frames.
        """
        self.split = split
        self.rows: Rows = middle_rows(dataset.labelled_rows(split))
        every = middle_rows(dataset.rows())
        labelled = every[np.isfinite(every["road_wheel_rad"])]
        judged: Flags = labelled["split"] == split
        self.true_rad: Angles = self.rows["road_wheel_rad"]
        learned = middle_rows((trained or dataset).rows("train"))["road_wheel_rad"]
        learned = learned[np.isfinite(learned)]
        ago = previous(labelled["road_wheel_rad"], labelled["t_s"], labelled["stretch"])
        self.predicted_rad: dict[str, Angles] = {
            STRAIGHT: np.zeros(len(self.true_rad)),
            MEAN: np.full(len(self.true_rad), learned.mean() if len(learned) else math.nan),
            PREVIOUS: ago[judged],
        }

    def scores(self, unit_deg: float) -> dict[str, Scores]:
        """MAE of each, with the number of its frames; ``unit_deg``: degrees of the answer per radian."""
        found: dict[str, Scores] = {}
        for name, angles in self.predicted_rad.items():
            known = np.isfinite(angles)
            mae_rad = float(np.abs(angles - self.true_rad)[known].mean()) if known.any() else None
            found[name] = {
                "mae_deg": None if mae_rad is None else mae_rad * unit_deg,
                "frames": int(known.sum()),
            }
        return found

    def learning(self, angle_rad: Angles, *, unit_deg: float = math.degrees(1.0)) -> Learning:
        """What the angles (n,) of a model say beside the baselines, on the frames that both answer.

        NaN where the model gives none. A model that is as near as a baseline counts as no better than it.
        """
        if not np.isfinite(angle_rad).any():
            finding = LearningDoubt("no_answer", "the model gives no angle for any frame")
            return Learning((finding,), "No angle, so that the frames say nothing about what was learned.")
        findings = [*no_variance(self.true_rad, self.split, unit_deg)]
        nearest, (model_rad, constant_rad) = min(
            ((name, self._pair(name, angle_rad)) for name in CONSTANTS),
            key=lambda one: one[1][1] if math.isfinite(one[1][1]) else math.inf,
        )
        if not model_rad < constant_rad:
            errors = f"{constant_rad * unit_deg:.2f}° of mean error against {model_rad * unit_deg:.2f}°"
            text = f"{CONSTANTS[nearest]} at all times is no worse than the model: {errors}"
            findings.append(LearningDoubt("no_better_than_constant", text))
        beside_rad, ago_rad = self._pair(PREVIOUS, angle_rad)
        if not beside_rad < ago_rad and math.isfinite(ago_rad):
            errors = f"{ago_rad * unit_deg:.2f}° of mean error against {beside_rad * unit_deg:.2f}°"
            text = f"the recorded angle of {AGO_S:g} s ago is no worse than the model: {errors}"
            findings.append(LearningDoubt("no_better_than_previous", text))
        return Learning(
            tuple(findings),
            _conclusion(
                {one.finding for one in findings},
                _share(model_rad, constant_rad),
                _share(beside_rad, ago_rad),
            ),
        )

    def _pair(self, name: str, angle_rad: Angles) -> tuple[float, float]:
        """Mean errors [rad] of the model and of a baseline on the frames that both answer; NaN without any."""
        angles = self.predicted_rad[name]
        both = np.isfinite(angle_rad) & np.isfinite(angles)
        if not both.any():
            return math.nan, math.nan
        true = self.true_rad[both]
        return float(np.abs(angle_rad[both] - true).mean()), float(np.abs(angles[both] - true).mean())


def no_variance(
    angles_rad: Angles | Floats, split: str, unit_deg: float = math.degrees(1.0)
) -> list[LearningDoubt]:
    """The finding that recorded angles hardly vary; empty where they do."""
    if not without_steering(angles_rad):
        return []
    spread_deg = float(np.std(angles_rad)) * unit_deg
    text = (
        f"the recorded angles of the {split} frames vary by {spread_deg:.2f}° alone: any constant angle"
        " fits them"
    )
    return [LearningDoubt("no_variance", text)]


def _share(model_rad: float, baseline_rad: float) -> str:
    return f"{model_rad / baseline_rad:.2f}" if baseline_rad > 0 else "-"


def _conclusion(found: set[str], of_constant: str, of_previous: str) -> str:
    """The closing sentence: what may be said about learning, and what to do next."""
    if "no_variance" in found:
        return (
            "These frames cannot show whether anything was learned: record bends to both sides, and judge on"
            " them."
        )
    if "no_better_than_constant" in found:
        return (
            "Nothing was learned: a constant angle does as well. Look at `trepid dataset show` for wrong or late"
            " labels, and record more bends."
        )
    better = f"The images count: {of_constant} of the error of the best constant angle"
    if "no_better_than_previous" in found:
        return (
            f"{better}. The angle of a moment ago is as near, so that this error says little about a drive: let"
            " the network drive in the simulator before a car."
        )
    return f"{better}" + (f", {of_previous} of that of the previous angle." if of_previous != "-" else ".")
