"""What the camera saw during a run, kept so that its worst moment can be shown as it was."""

from bisect import bisect_right
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from perception.estimators import Estimator
from perception.images.annotate import annotated
from sim_harness.lockstep.closed_loop import Parts, Result, Witness, build_parts, run
from sim_harness.scenarios.scenario import Scenario
from trepid.messages import Frame, SteeringEstimate, VehicleState

EVERY_S = 0.2  # a frame is kept; all of them would cost a tenth of the run's time
QUALITY, PICTURE_QUALITY = 90, 75  # of the JPEG that is kept, and of the one that is shown
PICTURE_PX = (480, 360)


@dataclass(slots=True)
class Shot:
    """A frame as JPEG, and what the estimators made of it."""

    t_s: float
    jpeg: bytes
    estimates: dict[str, SteeringEstimate] = field(default_factory=dict)


class Film:
    """A frame every 0.2 s with its estimates."""

    def __init__(self) -> None:
        self._shots: list[Shot] = []

    def watching(self, parts: Parts) -> Parts:
        """``parts`` whose estimators leave what they see in this film, and do nothing else differently."""
        estimators: Mapping[str, Estimator] = {
            name: _Watched(name, estimator, self) for name, estimator in parts.estimators.items()
        }
        return replace(parts, estimators=estimators)

    def add(self, name: str, frame: Frame, estimate: SteeringEstimate) -> None:
        """Keep ``frame`` if it is time, and what the estimator ``name`` made of it."""
        if not self._shots or frame.t_s >= self._shots[-1].t_s + EVERY_S - 1e-6:
            _, jpeg = cv2.imencode(".jpg", frame.image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            self._shots.append(Shot(frame.t_s, jpeg.tobytes()))
        if frame.t_s == self._shots[-1].t_s:
            self._shots[-1].estimates[name] = estimate

    def at(self, t_s: float) -> Shot | None:
        """The last frame by ``t_s``; None when there is none."""
        index = bisect_right([shot.t_s for shot in self._shots], t_s + 1e-6)
        return self._shots[index - 1] if index else None


class _Watched:
    """An estimator whose frames and answers are kept."""

    def __init__(self, name: str, estimator: Estimator, film: Film) -> None:
        self._name, self._estimator, self._film = name, estimator, film

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The answer of the estimator."""
        estimate = self._estimator.step(frame, state, now_s=now_s)
        self._film.add(self._name, frame, estimate)
        return estimate


def run_filmed(scenario: Scenario, *, seed: int, witness: Witness | None = None) -> tuple[Result, Film]:
    """:func:`run`, and what the camera saw. Raises InputError."""
    film = Film()
    parts = film.watching(build_parts(scenario, seed=seed))
    return run(scenario, seed=seed, parts=parts, witness=witness), film


def picture(shot: Shot) -> tuple[bytes, str]:
    """The frame with what the surest estimator saw drawn into it, as JPEG, and the name of that estimator."""
    image = cv2.imdecode(np.frombuffer(shot.jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None  # it was encoded here
    drawn = {name: found for name, found in shot.estimates.items() if found.left_boundary_px}
    sure = max(drawn or shot.estimates, key=lambda name: shot.estimates[name].confidence)
    shown = cv2.resize(
        annotated(image.astype(np.uint8), shot.estimates[sure]), PICTURE_PX, interpolation=cv2.INTER_AREA
    )
    _, jpeg = cv2.imencode(".jpg", shown, [cv2.IMWRITE_JPEG_QUALITY, PICTURE_QUALITY])
    return jpeg.tobytes(), sure
