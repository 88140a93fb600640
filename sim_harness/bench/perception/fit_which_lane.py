"""Weights of the confidence of `cv` without a camera file.

`python -m sim_harness.bench.perception.fit_which_lane --seed 1 --count 400` prints the sections ``searched`` and
``pair`` of ``street`` in config/perception.yaml. The samples are looks of unknown cameras at drawn streets and
roads (:mod:`.looks`); a lane is right where it covers the true one.

**Bound.** A logistic regression is calibrated where its samples come from. To hold elsewhere, the bias is lowered
until the bound below is kept for every family of roads while the weights are fitted to the others: with k of n
looks of the family wrong at a confidence above a half, (k + 1)/(n + 1) bounds the expected share (conformal risk
control: Angelopoulos et al., ICLR 2024), here of a family that was not in the fit.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import typer

from perception.camera.self_calibration import self_calibrated
from perception.estimators import lane_cv_settings
from perception.lane.agreement import overlap
from perception.lane.detection.evenness import columns
from perception.lane.street.settings import SearchedWeights, StreetWeights
from perception.lane.which_lane import WhichLane
from sim_harness.bench.perception.fit_confidence import fitted
from sim_harness.bench.perception.looks import Look, looks
from sim_harness.bench.perception.streets import StreetKind
from sim_harness.world.roads.drawn import UNMARKED
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import Frame
from trepid.speech.loudness import note
from trepid.types import Array, Mask

RIGHT = 0.75  # intersection over union with the true lane
ROWS = 48  # of the lower half of the image
WEIGHTS: tuple[type[Settings], ...] = SearchedWeights, StreetWeights
MAX_WRONG = 0.15  # expected share of looks of a new family that are wrong at a confidence above a half
MARGINS = np.arange(0.0, 4.0, 0.1)
FAMILIES: dict[str, str] = {
    **dict.fromkeys(UNMARKED, "unmarked"),
    StreetKind.TWO_WAY: "two ways",
    StreetKind.EDGED: "two ways",
    StreetKind.PARKING: "strips",
    StreetKind.CYCLE: "strips",
    StreetKind.BARE: "bare",
    StreetKind.ONE_WAY: "one way",
    StreetKind.LANES: "lanes",
}  # the other kinds are one family of marked roads


@dataclass(frozen=True)
class Samples:
    """Features of one finder, whether its lanes were right, and the families of roads."""

    inputs: Array  # (n, features)
    right: Mask
    family: Array  # (n,) of str


def samples(drawn: Iterable[Look]) -> tuple[Samples, Samples]:
    """Of the search between heights, and of the pairs."""
    settings, vehicle = lane_cv_settings(), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    found: tuple[list[tuple[tuple[float, ...], bool, str]], ...] = ([], [])
    for look in drawn:
        finder = WhichLane(settings, self_calibrated([look.image], settings.self_calibration), vehicle)
        finder.step(Frame(t_s=0.0, image=look.image), None, now_s=0.0)
        truth = _between(look.left_px, look.right_px, look)
        for rows, one in zip(found, finder.looks, strict=False):
            paths = one.estimate.left_boundary_px, one.estimate.right_boundary_px
            left, right = (np.array(path).reshape(-1, 2) for path in paths)
            lane = _between(left, right, look)
            rows.append((one.features, overlap(lane, truth) > RIGHT, FAMILIES.get(look.kind, "marked")))
        if look.number % 50 == 0:
            note(f"look {look.number}")
    searched, paired = (Samples(*(np.array(column) for column in zip(*rows, strict=True))) for rows in found)
    return searched, paired


def _between(left_px: Array, right_px: Array, look: Look) -> Array:
    """Columns of both boundaries at rows of the lower half of the image, (2, ROWS); 0 where not known."""
    height, width = look.image.shape[:2]
    rows = np.linspace(height / 2, height - 1, ROWS)
    paths = (tuple(map(tuple, path.tolist())) for path in (left_px, right_px))
    found = np.clip(np.stack([columns(path, rows) for path in paths]), 0, width)
    return np.where(np.isnan(found).any(axis=0), 0.0, found)


def margin(known: Samples) -> float:
    """The least decrease of the bias with which the bound holds for every family that is left out of the fit."""
    worst = 0.0
    for family in sorted(set(known.family.tolist())):
        own = known.family == family
        weights = fitted(known.inputs[~own], known.right[~own].astype(float))
        wrong = np.sort((known.inputs[own] @ weights)[~known.right[own]])
        for lower in MARGINS:
            if (np.count_nonzero(wrong > lower) + 1) / (np.count_nonzero(own) + 1) <= MAX_WRONG:
                break
        worst = max(worst, float(lower))
    return worst


def main(
    seed: Annotated[int, typer.Option(help="Seed of the looks.")] = 1,
    count: Annotated[int, typer.Option(help="Number of looks.")] = 400,
) -> None:
    """Draw the looks, search, fit, print the weights."""
    sections = zip(samples(looks(seed, count)), WEIGHTS, ("searched", "pair"), strict=True)
    for known, section, name in sections:
        weights, lower = fitted(known.inputs, known.right.astype(float)), margin(known)
        weights[0] -= lower
        right = 100 * known.right.mean()
        print(f"  # {len(known.right)} samples, {right:.1f} % right; bias lowered by {lower:.1f}")
        fields: list[str] = list(section.model_fields)
        shown = (f"{field}: {weight:.2f}" for field, weight in zip(fields, weights, strict=True))
        print(f"  {name}: {{{', '.join(shown)}}}")


if __name__ == "__main__":
    typer.run(main)
