"""Random drives of ``trepid bench fear-supervision``: clean marked roads, and hard ones."""

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sim_harness.scenarios.scenario import Appearance, Scenario, Start, Tag
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.drawn import (
    SNOW_COVER,
    BendShape,
    MarkingKind,
    random_section,
    random_segments,
    snow_on,
)

CLEAN_DRIVES = 28  # of some 400 m each
CLEAN_KINDS = (
    MarkingKind.WHITE,
    MarkingKind.YELLOW,
    MarkingKind.DOUBLE,
    MarkingKind.DASHED,
    MarkingKind.MULTI_LANE,
)
CLEAN_SPEED_MPS = 8.0
HARD_RADII_M, HARD_ROUTE_M = (35.0, 100.0), 170.0
HARD_SPEEDS_MPS = (5.0, 9.0)
GRADES = (3, 4, 5)
SNOWED_UP = 0.2  # of the hard roads: trodden snow hides lines and edges
OFTEN = ("snow", "fog", "rain", "night", "glare", "over_exposure", "dirt", "occlusion")
"""Disturbances that are drawn three times as often: they hide the road."""


@dataclass(frozen=True)
class SupervisionCase:
    """One drive to be driven by every driver."""

    scenario: Scenario
    seed: int
    clean: bool

    @property
    def key(self) -> str:
        """Unique key of the case."""
        content = f"{self.seed} {self.scenario.model_dump_json()}"
        return hashlib.sha256(content.encode()).hexdigest()[:16]


def cases(seed: int, count: int) -> Iterator[SupervisionCase]:
    """Clean cases first, then ``count`` hard ones; a larger count extends the same sequence."""
    for number in range(CLEAN_DRIVES):
        rng = np.random.default_rng([seed, 70, number])
        yield SupervisionCase(_clean(rng), int(rng.integers(2**31)), clean=True)
    for number in range(count):
        rng = np.random.default_rng([seed, 71, number])
        yield SupervisionCase(_hard(rng), int(rng.integers(2**31)), clean=False)


def _clean(rng: np.random.Generator) -> Scenario:
    """Well marked asphalt by day: two bends, or two of hardly any curvature."""
    kind = CLEAN_KINDS[int(rng.integers(len(CLEAN_KINDS)))]
    shape = BendShape(str(rng.choice(["straight", "bend"])))
    return Scenario(
        name="clean",
        description=f"{kind}, {shape}",
        tags=(Tag.NOMINAL,),
        road="straight",
        segments=(*random_segments(shape, rng), *random_segments(shape, rng)),
        lane_width_m=round(float(rng.uniform(2.9, 3.75)), 2),
        appearance=_look(kind, rng),
        start=Start(speed_mps=CLEAN_SPEED_MPS),
        speed_mps=CLEAN_SPEED_MPS,
        duration_s=90.0,
    )


def _hard(rng: np.random.Generator) -> Scenario:
    """Any kind of road, snowed up at times, under a strong disturbance, with a lasting bend after 40 m."""
    kind = tuple(MarkingKind)[int(rng.integers(len(MarkingKind)))]
    look = _look(kind, rng)
    snowed_up = bool(rng.random() < SNOWED_UP)
    if snowed_up:
        snow = snow_on(round(float(rng.uniform(*SNOW_COVER)), 2))
        look = Appearance.model_validate({**look.model_dump(), **snow})
    weights = np.array([3.0 if name.value in OFTEN else 1.0 for name in DisturbanceKind])
    disturbance = Disturbance(
        kind=tuple(DisturbanceKind)[int(rng.choice(len(weights), p=weights / weights.sum()))],
        grade=int(rng.choice(GRADES)),
        from_m=float(rng.choice([0.0, 40.0])),
    )
    curvature_1pm = round(float(rng.choice([-1, 1])) / float(rng.uniform(*HARD_RADII_M)), 4)
    speed_mps = round(float(rng.uniform(*HARD_SPEEDS_MPS)), 1)
    return Scenario.model_validate(
        {
            "name": "hard",
            "description": f"{kind}{' in snow' if snowed_up else ''}, {disturbance.kind} {disturbance.grade:g},"
            f" R = {1 / curvature_1pm:.0f} m, {speed_mps} m/s",
            "tags": ["weather"],
            "road": "straight",
            "segments": [
                {"length_m": 40},
                {"length_m": 25, "curvature_1pm": [0, curvature_1pm]},
                {"length_m": 120, "curvature_1pm": curvature_1pm},
            ],
            "appearance": look,
            "disturbances": [disturbance],
            "start": {"speed_mps": speed_mps},
            "speed_mps": speed_mps,
            "duration_s": 40.0,
            "distance_m": HARD_ROUTE_M,
        }
    )


def _look(kind: MarkingKind, rng: np.random.Generator) -> Appearance:
    section = random_section(kind, rng)
    return Appearance.model_validate(section.model_dump(exclude={"name", "start_m"}))
