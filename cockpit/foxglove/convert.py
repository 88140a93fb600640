"""A copy of a recording with what Foxglove and Lichtblick draw; it stays a recording that every verb takes."""

from collections.abc import Callable
from pathlib import Path

from cockpit.foxglove.ros import TYPES, definition
from cockpit.foxglove.scene import Scene
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clock import seconds
from trepid.config import CONFIG_DIR, load
from trepid.recording.foreign import in_order
from trepid.recording.reader import RecordingContent
from trepid.recording.writer import Recording

DEFINITIONS = {key: (name, definition(key)) for key, name in TYPES.items()}
"""Key of a topic of the viewers -> its type and definition."""


def write_viewable(recorded: RecordingContent, out: Path, done: Callable[[float], None]) -> int:
    """Write the recording with the topics of the viewers to ``out``; return the number of messages added.

    Such topics of the recording itself are made anew. ``done`` is called with the share that is written. The
    settings of camera and vehicle are those in use. Raises InputError.
    """
    scene = Scene(load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    length_s = max(recorded.last_s - recorded.first_s, 1e-9)
    added = 0
    with Recording(out, recorded.files, recorded.notes, further=DEFINITIONS) as file:
        for log_ns, key, data in in_order(recorded.path):
            if key in TYPES:
                continue
            at_s = seconds(log_ns)
            file.add(key, data, at_s=at_s)
            for derived, content in scene.step(key, data):
                file.add(derived, content, at_s=at_s)
                added += 1
            done((at_s - recorded.first_s) / length_s)
    return added
