"""Weights of the confidence of `cv` and of `segments` without a camera file.

`python -m lab.bench.perception.fit_which_lane --seed 1 --count 400` prints the sections ``searched`` and
``pair`` of ``street`` in config/perception.yaml; with ``--estimator segments`` those of config/segments.yaml.
The samples are looks of unknown cameras at drawn streets and
roads (:mod:`.looks`); a lane is right where both boundaries lie within a quarter of its width from the true ones,
as for lanes on real frames that are judged by eye.

**Bound.** A logistic regression is calibrated where its samples come from. To hold elsewhere, the bias is lowered
until the bound below is kept for every family of roads while the weights are fitted to the others: with k of n
looks of the family wrong at a confidence above a half, (k + 1)/(n + 1) bounds the expected share (conformal risk
control: Angelopoulos et al., ICLR 2024), here of a family that was not in the fit.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
import typer

from lab.bench.perception.fit_confidence import fit_weights
from lab.bench.perception.looks import Look, looks
from lab.bench.real.judgement import BESIDE, within
from lab.bench.real.look import LANE_ROWS, lane_at
from perception.camera.self_calibration import calibrate_by_images
from perception.estimators import lane_cv_settings
from perception.lane.detection.evenness import columns
from perception.lane.settings import LaneCvSettings
from perception.lane.street.settings import SearchedWeights, StreetWeights
from perception.lane.which_lane import WhichLane
from perception.segments.estimator import NAME as SEGMENTS
from perception.segments.estimator import segmenter_of
from perception.segments.picture import draw_masks
from perception.segments.settings import lane_settings, segment_settings
from sim_harness.world.roads.drawn import UNMARKED
from sim_harness.world.streets import StreetKind
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, Settings, load
from trepid.loudness import note
from trepid.messages import Frame, PixelPath, SteeringEstimate
from trepid.types import Array, Mask

WEIGHTS: tuple[type[Settings], ...] = SearchedWeights, StreetWeights
MAX_WRONG = 0.07  # expected share of looks of a new family that are wrong at a confidence above a half
MAX_WRONG_OF_ALL = 0.02  # the same of all looks, for masks of a network that was not trained on drawn roads
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


def as_masks(drawn: Iterable[Look]) -> Iterator[Look]:
    """The pictures of the masks of ``drawn``, as `segments` sees them. Raises InputError without the network."""
    segmenter = segmenter_of(segment_settings())
    for look in drawn:
        image = draw_masks(segmenter(look.image))
        scale = image.shape[1] / look.image.shape[1]
        left_px, right_px = ((side + 0.5) * scale - 0.5 for side in (look.left_px, look.right_px))
        yield replace(look, image=image, left_px=left_px, right_px=right_px)


def samples(drawn: Iterable[Look], settings: LaneCvSettings) -> tuple[Samples, Samples]:
    """Of the search between heights, and of the pairs."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    found: tuple[list[tuple[tuple[float, ...], bool, str]], ...] = ([], [])
    for look in drawn:
        camera = calibrate_by_images([look.image], settings.self_calibration)
        finder = WhichLane(settings, camera, vehicle, bonnet=False)
        finder.step(Frame(t_s=0.0, image=look.image), None, now_s=0.0)
        for rows, one in zip(found, finder.looks, strict=False):
            rows.append((one.features, is_right(one.estimate, look), FAMILIES.get(look.kind, "marked")))
        if look.number % 50 == 0:
            note(f"look {look.number}")
    searched, paired = (Samples(*(np.array(column) for column in zip(*rows, strict=True))) for rows in found)
    return searched, paired


def is_right(estimate: SteeringEstimate, look: Look) -> bool:
    """Whether the lane of ``estimate`` is that of the car in ``look``."""
    rows_px = np.array(LANE_ROWS) * look.image.shape[0]
    truth = np.array([columns(_path(side), rows_px) for side in (look.left_px, look.right_px)])
    return within(lane_at(estimate, rows_px), truth, BESIDE) is True


def _path(pixels: Array) -> PixelPath:
    return tuple((float(x_px), float(y_px)) for x_px, y_px in pixels)


def margin(known: Samples) -> float:
    """The least decrease of the bias with which the bound holds for every family that is left out of the fit."""
    scores = left_out(known)
    families = [known.family == family for family in sorted(set(known.family.tolist()))]
    return max(_least(scores[own], known.right[own], MAX_WRONG) for own in families)


def common_margin(known: Samples) -> float:
    """The same for all looks together, each scored by a fit without its family: ``MAX_WRONG_OF_ALL``."""
    return _least(left_out(known), known.right, MAX_WRONG_OF_ALL)


def left_out(known: Samples) -> Array:
    """w·x of each look, with the weights fitted to the other families; shape (n,)."""
    scores = np.zeros(len(known.right))
    for family in sorted(set(known.family.tolist())):
        own = known.family == family
        scores[own] = known.inputs[own] @ fit_weights(known.inputs[~own], known.right[~own].astype(float))
    return scores


def _least(scores: Array, right: Mask, bound: float) -> float:
    wrong = scores[~right]
    kept = ((np.count_nonzero(wrong > lower) + 1) / (len(right) + 1) <= bound for lower in MARGINS)
    return float(next((lower for lower, keeps in zip(MARGINS, kept, strict=True) if keeps), MARGINS[-1]))


def main(
    seed: Annotated[int, typer.Option(help="Seed of the looks.")] = 1,
    count: Annotated[int, typer.Option(help="Number of looks.")] = 400,
    estimator: Annotated[str, typer.Option(help="cv or segments.")] = "cv",
) -> None:
    """Draw the looks, search, fit, print the weights."""
    drawn, margin_of, settings = looks(seed, count), margin, lane_cv_settings()
    if estimator == SEGMENTS:
        drawn, margin_of = as_masks(drawn), common_margin
        settings = lane_settings(settings, segment_settings())
    sections = zip(samples(drawn, settings), WEIGHTS, ("searched", "pair"), strict=True)
    for known, section, name in sections:
        weights, lower = fit_weights(known.inputs, known.right.astype(float)), margin_of(known)
        weights[0] -= lower
        right = 100 * known.right.mean()
        print(f"  # {len(known.right)} samples, {right:.1f} % right; bias lowered by {lower:.1f}")
        fields: list[str] = list(section.model_fields)
        shown = (f"{field}: {weight:.2f}" for field, weight in zip(fields, weights, strict=True))
        print(f"  {name}: {{{', '.join(shown)}}}")


if __name__ == "__main__":
    typer.run(main)
