"""Estimators on images, folders, videos and recordings, from Python: ``trepid.estimate``."""

import os
from collections.abc import Callable, Generator, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import TypeVar

import cv2

from cockpit.footage.frames import CameraFor, FrameResult, Step, Unread, results
from cockpit.footage.leads import Leads, lead_results
from cockpit.footage.sources import Footage, Source, Still
from perception.camera.self_calibration import CALIBRATION_FRAMES, calibrate_by_images
from perception.estimators import (
    ESTIMATORS,
    NETWORK_SUFFIX,
    Entry,
    entry_of,
    estimators,
    lane_cv_settings,
    no_estimator,
)
from perception.lane.outline import with_boundaries
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, car_folder, load, use_car
from trepid.images.files import NOMINAL_FPS
from trepid.loudness import note
from trepid.messages import SteeringEstimate
from trepid.scale import scaled_settings
from trepid.types import Image

R = TypeVar("R")
ASSUMED = "no --camera given: metres rest on an assumed camera, its horizon found in each image or clip"
Paths = str | Path | Iterable[str | Path]
"""One or more images, folders of images, videos, recordings (.mcap)."""


def estimate(
    inputs: Paths,
    estimator: str = "cv",
    *,
    camera: str | Path | None = None,
    car: str | Path | None = None,
    as_drive: bool = False,
    fps: float = NOMINAL_FPS,
    strict: bool = True,
    unread: Unread | None = None,
) -> Iterator[FrameResult[SteeringEstimate]]:
    """The estimate of the lane in every frame of ``inputs``, in order, as ``trepid estimate`` gives them.

    A still image is estimated by itself; the frames of a video, of a recording and, with ``as_drive``, of a folder
    are tracked. Each result has ``path``, ``number``, ``t_s`` [s], ``image`` (BGR uint8, shape (h, w, 3)), the
    ``camera`` used, ``latency_ms``, and as ``result`` a :class:`trepid.messages.SteeringEstimate`: SI units, left
    positive, None where nothing was found.

    ``estimator``: a name that ``trepid estimate --estimator list`` prints, or the file of a driving network.
    ``camera``: a camera file; without it that of ``car`` or of the recording, else a typical one with the horizon
    of the images.
    ``fps``: frames per second of a folder with ``as_drive``. Without ``strict``, unreadable images of a folder are
    named on standard error and left out; ``unread``, in its place, also counts them. Raises InputError at the first
    frame that is asked for.
    """
    unread, drive_fps = unread or Unread(strict=strict), fps if as_drive else None
    found = _begin_on_demand(
        lambda: _lane_results(as_paths(inputs), estimator, _path(camera), unread, drive_fps)
    )
    return in_car(car, found)


def find_leads(
    inputs: Paths,
    detector: str | Path | None = None,
    *,
    camera: str | Path | None = None,
    car: str | Path | None = None,
    as_drive: bool = False,
    fps: float = NOMINAL_FPS,
    strict: bool = True,
    unread: Unread | None = None,
) -> Iterator[FrameResult[Leads]]:
    """The vehicles in every frame of ``inputs``, as ``trepid estimate --estimator lead`` gives them.

    ``detector``: a name that ``trepid detector list`` prints, or a file; without it that of ``lead.yaml``. The
    other parameters and the results are those of :func:`estimate`; ``result`` has ``lead`` and ``detections``.
    """
    unread, drive_fps = unread or Unread(strict=strict), fps if as_drive else None

    def begin() -> Iterator[FrameResult[Leads]]:
        return lead_results(
            as_paths(inputs), cameras(_path(camera))[0], unread, _path(detector), drive_fps=drive_fps
        )

    return in_car(car, _begin_on_demand(begin))


def _lane_results(
    inputs: Iterable[Path], estimator: str, camera: Path | None, unread: Unread, drive_fps: float | None
) -> Iterator[FrameResult[SteeringEstimate]]:
    check_estimator(estimator)
    camera_for, assumed = cameras(camera)
    step = partial(_step, entry_of(estimator), assumed)
    return results(inputs, camera_for, step, unread, drive_fps=drive_fps)


def check_estimator(name: str, *further: str) -> None:
    """Raise InputError unless ``name`` is an estimator, the file of a driving network, or one of ``further``."""
    if name in (*ESTIMATORS, *further) or name.endswith(NETWORK_SUFFIX):
        return
    if name not in estimators():
        raise InputError(no_estimator(name, (*estimators(), *further)))


def cameras(file: Path | None) -> tuple[CameraFor, bool]:
    """The camera of each source, and whether it is assumed because neither ``file`` nor a car gives it.

    That of a recorded drive is known in each case. Raises InputError.
    """
    cv2.setNumThreads(1)
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # FFmpeg prints nothing: errors are reported here
    file = file or _camera_of_the_car()
    return partial(_camera_for, load(file, Camera) if file else None), file is None


def in_car(car: str | Path | None, found: Iterator[R]) -> Iterator[R]:
    """``found``, each item of which is computed with the settings of ``car``, or of the recorded car.

    The caller's own are in use between two items.
    """
    inside = _path(car) or car_folder()
    try:
        while True:
            outside = car_folder()
            _change_car(inside)
            try:
                one = next(found)
            except StopIteration:
                return
            finally:
                inside = car_folder()  # that of a recording, while it is read
                _change_car(outside)
            yield one
    finally:
        outside = car_folder()
        if isinstance(found, Generator):
            found.close()
        _change_car(outside)


def _change_car(folder: Path | None) -> None:
    if folder != car_folder():
        use_car(folder)


def as_paths(inputs: Paths) -> list[Path]:
    """``inputs`` as paths. Raises InputError for none."""
    paths = [Path(inputs)] if isinstance(inputs, str | Path) else [Path(one) for one in inputs]
    if not paths:
        raise InputError("name at least one image, folder or video")
    return paths


def _begin_on_demand(begin: Callable[[], Iterator[R]]) -> Iterator[R]:
    """``begin()``, begun when the first item is asked for."""
    yield from begin()


def _path(path: str | Path | None) -> Path | None:
    return None if path is None else Path(path)


def brings_camera(source: Source) -> bool:
    """Whether ``source`` is a recording whose settings contain its camera."""
    return isinstance(source, Footage) and source.has_settings


def _step(entry: Entry, assumed: bool, source: Source, camera: Camera) -> Step[SteeringEstimate]:
    """A fresh estimator, stepped without odometry; a lane without boundaries gets those of its width."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    estimator = entry.build(camera, vehicle, assumed=assumed and not brings_camera(source))
    return lambda frame: with_boundaries(estimator.step(frame, None, now_s=frame.t_s), camera, vehicle)


def _camera_of_the_car() -> Path | None:
    """The camera file that the folder of a car overrides; None without one."""
    car = car_folder()
    return CONFIG_DIR / "camera.yaml" if car is not None and (car / "camera.yaml").exists() else None


def _camera_for(known: Camera | None, source: Source, image: Image) -> Camera:
    """The given camera, or that of a recorded drive, at the size of the image; else an assumed one.

    An assumed camera has the horizon of the image or clip, and is as high as the lanes of the vehicle are wide.
    """
    if known is None and brings_camera(source):
        known = load(CONFIG_DIR / "camera.yaml", Camera)
    if known is not None:
        return known.resize(image.shape[1], image.shape[0])
    if isinstance(source, Footage):
        note(f"{source.path}: states no camera: {ASSUMED}")
    scale = load(CONFIG_DIR / "vehicle.yaml", Vehicle).scale
    images = [image] if isinstance(source, Still) else source.sample(CALIBRATION_FRAMES)
    return scaled_settings(calibrate_by_images(images, lane_cv_settings().self_calibration), scale)
