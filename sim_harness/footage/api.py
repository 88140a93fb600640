"""Fear of footage from Python: ``trepid.rate``."""

from collections.abc import Iterable, Iterator
from pathlib import Path

from cockpit.footage.api import Paths, as_paths, cameras, check_estimator, in_car
from cockpit.footage.frames import FrameResult, Unread
from perception.estimators import ESTIMATORS
from sim_harness.footage.frame_fear import fear_results, given_motion
from sim_harness.footage.onlooker import FrameJudgement
from trepid.images.files import NOMINAL_FPS


def rate(
    inputs: Paths,
    estimators: Iterable[str] = (),
    *,
    speed_mps: float | None = None,
    speeds: str | Path | None = None,
    detector: str | Path | None = None,
    camera: str | Path | None = None,
    car: str | Path | None = None,
    as_drive: bool = False,
    fps: float = NOMINAL_FPS,
    strict: bool = True,
    unread: Unread | None = None,
) -> Iterator[FrameResult[FrameJudgement]]:
    """The fear of every frame of ``inputs``, as ``trepid estimate --fear`` gives it.

    ``result`` of each frame has ``estimates`` (by name), ``lead`` (None: no detector ran) and ``decision``, a
    :class:`trepid.messages.Decision` with fear, cause, mode and the rules that fired. ``estimators``: names or
    files of driving networks, beside ``cv`` and ``cnn``. ``speed_mps`` or the log ``speeds`` (``t_s, speed_mps``
    and, where known, ``yaw_rate_radps`` by row) gives the motion of the car; a recording has its own. The other
    parameters are those of :func:`trepid.estimate`. Raises InputError at the first frame that is asked for.
    """

    def begin() -> Iterator[FrameResult[FrameJudgement]]:
        names = estimators_to_rate(estimators)
        for name in names:
            check_estimator(name)
        camera_for, assumed = cameras(None if camera is None else Path(camera))
        motion = given_motion(speed_mps, None if speeds is None else Path(speeds))
        finder = None if detector is None else Path(detector)
        drive_fps = fps if as_drive else None
        yield from fear_results(
            as_paths(inputs),
            camera_for,
            unread or Unread(strict=strict),
            assumed,
            motion,
            finder,
            names,
            drive_fps=drive_fps,
        )

    return in_car(car, begin())


def estimators_to_rate(estimators: Iterable[str]) -> tuple[str, ...]:
    """The estimators of a rating, each once: ``cv`` and ``cnn``, then the given ones."""
    return tuple(dict.fromkeys((*ESTIMATORS, *estimators)))
