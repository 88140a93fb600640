"""What a report shows of the moments of a run: camera frames, other vehicles, rules that fired."""

from bisect import bisect_right
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from cockpit.footage.annotate import annotate, with_lane
from drive.reason import fired_rules
from perception.estimators import Estimator
from sim_harness.lockstep.closed_loop import Instant, Parts, Result, Witness, build_parts, run
from sim_harness.scenarios.scenario import Scenario
from trepid.bounds import at_least
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Image

EVERY_S = 0.2  # interval of the stored frames; encoding all of them would take a tenth of the run time
QUALITY, PICTURE_QUALITY = 90, 75  # of the stored and of the shown JPEG
PICTURE_PX = (480, 360)
SMALL_PX, SMALL_QUALITY = (320, 240), 60  # of the frames under the cursor


@dataclass(slots=True)
class FilmFrame:
    """A frame as JPEG with its estimates."""

    t_s: float
    jpeg: bytes
    estimates: dict[str, SteeringEstimate] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Glimpse:
    """The other vehicles and the rules that fired at one time."""

    t_s: float
    others: tuple[tuple[float, float, float], ...]
    """x [m], y [m] and yaw [rad] of each other vehicle."""
    rules: tuple[tuple[str, float], ...]
    """Text and strength of each rule that fired, strongest first."""


class Film:
    """A frame with its estimates, and a glimpse of the rest, every 0.2 s."""

    def __init__(self) -> None:
        self._shots: list[FilmFrame] = []
        self.glimpses: list[Glimpse] = []

    @property
    def shots(self) -> list[FilmFrame]:
        """The stored frames, in order."""
        return self._shots

    def witness(self, now: Instant) -> None:
        """Store a glimpse when the interval has passed."""
        if self.glimpses and now.now_s < self.glimpses[-1].t_s + EVERY_S - 1e-6:
            return
        truth, decision = now.truth, now.decision
        others = zip(truth.traffic_x_m, truth.traffic_y_m, truth.traffic_yaw_rad, strict=True)
        rules = tuple(fired_rules(decision)) if decision else ()
        self.glimpses.append(Glimpse(now.now_s, tuple(others), rules))

    def watching(self, parts: Parts) -> Parts:
        """``parts`` with estimators that also store frames and estimates in this film."""
        estimators: Mapping[str, Estimator] = {
            name: _WatchedEstimator(name, estimator, self) for name, estimator in parts.estimators.items()
        }
        return replace(parts, estimators=estimators)

    def add(self, name: str, frame: Frame, estimate: SteeringEstimate) -> None:
        """Store ``frame`` when the interval has passed, and the estimate of ``name`` for a stored frame."""
        if not self._shots or frame.t_s >= self._shots[-1].t_s + EVERY_S - 1e-6:
            _, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            self._shots.append(FilmFrame(frame.t_s, jpeg.tobytes()))
        if frame.t_s == self._shots[-1].t_s:
            self._shots[-1].estimates[name] = estimate

    def at(self, t_s: float) -> FilmFrame | None:
        """The last frame up to ``t_s``, or None."""
        index = bisect_right([shot.t_s for shot in self._shots], t_s + 1e-6)
        return self._shots[index - 1] if index else None


class _WatchedEstimator:
    """An estimator whose frames and estimates are stored."""

    def __init__(self, name: str, estimator: Estimator, film: Film) -> None:
        self._name, self._estimator, self._film = name, estimator, film

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate of the estimator."""
        estimate = self._estimator.step(frame, state, now_s=now_s)
        self._film.add(self._name, frame, estimate)
        return estimate


def run_filmed(scenario: Scenario, *, seed: int, witness: Witness | None = None) -> tuple[Result, Film]:
    """:func:`run` with its film. Raises InputError."""
    film = Film()
    parts = film.watching(build_parts(scenario, seed=seed))

    def both(now: Instant) -> None:
        film.witness(now)
        if witness is not None:
            witness(now)

    return run(scenario, seed=seed, parts=parts, witness=both), film


def picture(shot: FilmFrame) -> tuple[bytes, str]:
    """The frame with the lane of the most confident estimator, as JPEG, and the name of the estimator."""
    return _draw_frame(shot, annotate, PICTURE_PX, PICTURE_QUALITY)


def small_picture(shot: FilmFrame) -> bytes:
    """The frame with the lane of the most confident estimator, without numbers, as a small JPEG."""
    return _draw_frame(shot, with_lane, SMALL_PX, SMALL_QUALITY)[0]


def _draw_frame(
    shot: FilmFrame, draw: Callable[[Image, SteeringEstimate], Image], size: tuple[int, int], quality: int
) -> tuple[bytes, str]:
    image = cv2.imdecode(np.frombuffer(shot.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None  # encoded by this module
    found = {name: one for name, one in shot.estimates.items() if one.left_boundary_px}
    sure = max(found or shot.estimates, key=lambda name: at_least(shot.estimates[name].confidence, 0.0))
    shown = cv2.resize(draw(image.astype(np.uint8), shot.estimates[sure]), size, interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return jpeg.tobytes(), sure
