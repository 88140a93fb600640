"""Recordings of Trepid (``trepid drive --record``): camera images and the vehicle state at their capture times."""

import math
from pathlib import Path

import numpy as np

from learning.dataset.sources.log import Faults, Log, SteeringUnit
from trepid.clock import nanoseconds
from trepid.config import InputError
from trepid.recording.foreign import topics_in_words, types_of
from trepid.recording.interpolation import between
from trepid.recording.reader import read_recording
from trepid.recording.scan import CUT_SHORT, images_in_words, leave_out
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE, VEHICLE_STATE, estimate_topic
from trepid.types import Column
from vehicle.cameras.files import mcap_shots
from vehicle.cameras.ros_images import TYPES

SUFFIX = ".mcap"
BEFORE, SILENT = "before the drive began", "no vehicle state at this time"
UNSEEN = "no estimate of this frame"


def read_drive(path: Path, faults: Faults, *, labels_of: str | None = None) -> Log:
    """The frames of a recording. Raises InputError when it holds no images or no vehicle state.

    ``labels_of``: label the frames by the estimates of this estimator, instead of the measured steering.
    """
    topic, ros_type = _images(path)
    lost: dict[str, int] = {}  # corrupted part -> images in it

    def lose_images(what: str, messages: int) -> None:
        lost[what] = messages

    t_s = np.array([shot.t_s for shot in mcap_shots(path, topic, ros_type, damage=lose_images)])
    recorded = read_recording(path, VEHICLE_STATE.key, damage=leave_out)
    cut_short = lost.pop(CUT_SHORT, None) is not None
    lost |= {what: 0 for what in recorded.lost if what not in lost}
    states = {state.t_s: state for _, state in reversed(recorded.of(VEHICLE_STATE))}
    if not len(t_s) or not states:
        what = "image of a camera" if not len(t_s) else "vehicle state: it holds no steering to learn from"
        raise InputError(f"{path}: no {what}")
    for what, images in lost.items():
        faults(f"{path}: {images_in_words(what, images)}", rows=images)
    for key, count in recorded.malformed.items():
        faults(f"{path}: {count} messages of {key} are malformed")
    at_s = np.array(sorted(states))

    def column(name: str) -> Column:
        values = np.array([getattr(states[t], name) for t in at_s], dtype=np.float64)  # None: NaN
        return between(t_s, at_s, values)

    measured = labels_of is None
    steering = (
        column("road_wheel_angle_rad") if labels_of is None else estimated_angles_rad(path, labels_of, t_s)
    )
    began_s = recorded.began_s if recorded.began_s is not None else -math.inf
    log = Log(
        kind="recording",
        path=path,
        root=path.parent,
        files=(path,),
        image=[path.name] * len(t_s),
        item=np.arange(len(t_s)),
        t_s=t_s,
        route=[path.stem] * len(t_s),
        steering=steering,
        speed_mps=column("speed_mps"),
        yaw_rate_radps=column("yaw_rate_radps"),
        why=[
            BEFORE if t < began_s else (SILENT if measured else UNSEEN) if math.isnan(angle) else ""
            for t, angle in zip(t_s.tolist(), steering.tolist(), strict=True)
        ],
        unit=SteeringUnit.ROAD if measured else SteeringUnit.KINEMATIC,
        left_positive=True,
        topic=topic,
    )
    log.notes.append(f"images of {topic}, {VEHICLE_STATE.key} at their capture times")
    if not measured:
        log.notes.append(f"angles of the estimator {labels_of}")
    if lost:
        log.notes.append(f"{len(lost)} corrupted parts are left out, with {sum(lost.values())} images")
    if cut_short:
        log.notes.append("cut short; read up to its last whole chunk")
    return log


def _images(path: Path) -> tuple[str, str]:
    """Topic and type of the images: of full size, else compressed, else the only one. Raises InputError."""
    topics = {topic: name for topic, name in types_of(path).items() if name in TYPES}
    for wanted in (CAMERA_IMAGE.key, CAMERA_COMPRESSED.key):
        if f"/{wanted}" in topics:
            return f"/{wanted}", topics[f"/{wanted}"]
    if len(topics) != 1:
        none = f"no topic with images, but {topics_in_words(path)}"
        held = f"several topics with images: {', '.join(topics)}" if topics else none
        raise InputError(f"{path}: {held}; expected one, or {CAMERA_COMPRESSED.key}")
    return next(iter(topics.items()))


def estimated_angles_rad(path: Path, name: str, t_s: Column) -> Column:
    """The road-wheel angles that the estimator ``name`` gave for the frames taken at ``t_s`` [rad]; NaN without."""
    topic = estimate_topic(name)
    recorded = read_recording(path, topic.key, damage=leave_out).of(topic)
    angles = {nanoseconds(one.t_s): one.road_wheel_angle_rad for _, one in recorded}
    return np.array([angles.get(nanoseconds(t)) for t in t_s.tolist()], dtype=np.float64)  # None: NaN
