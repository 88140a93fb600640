"""A copy of a recording in which some messages are replaced."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trepid.clock import seconds
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import CAR_FILES, Recording
from trepid.wire import to_cdr

RULES_NAME = "fear.yaml"


def copy_recording(
    source: Path,
    out: Path,
    replaced: Mapping[str, Mapping[float, Any]],
    *,
    notes: Mapping[str, str],
    rules: bytes,
) -> None:
    """Write ``source`` to ``out`` with other messages, the further ``notes`` and the rule file ``rules``.

    ``replaced``: key of a topic -> time of a message on it -> the message in its place; the other messages of
    these topics are left out. Raises InputError.
    """
    held = read_recording(source)
    own = {name: data for name, data in held.files.items() if name.startswith(CAR_FILES)}
    with Recording(out, {RULES_NAME: rules, **own}, {**held.notes, **notes}) as recording:
        for log_ns, key, data in in_order(source):
            at_s = seconds(log_ns)
            if key not in replaced:
                recording.add(key, data, at_s=at_s)
            elif at_s in replaced[key]:
                recording.add(key, to_cdr(replaced[key][at_s]), at_s=at_s)
