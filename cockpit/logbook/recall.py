"""A recorded drive from the side of the supervisor: its decisions, its inputs and its rules."""

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from supervisor.rules.inference import FearRules
from supervisor.rules.reload import FROM_S, TEXT
from trepid.config import InputError, default_file
from trepid.messages import CompressedFrame, Decision, SteeringEstimate, VehicleState
from trepid.recording.reader import Recorded, read_recording
from trepid.recording.writer import CAR_FILES
from trepid.topics import CAMERA_COMPRESSED, COMMAND, DECISION, DIAGNOSTICS, VEHICLE_STATE, estimate_topic
from trepid.types import Column

RULES_NAME = "fear.yaml"
_KEYS = (DECISION.key, VEHICLE_STATE.key, COMMAND.key, estimate_topic("*").key, DIAGNOSTICS.key)
_FRAME_WITHIN_S = 1.0  # greatest age of the camera image of a decision


@dataclass(frozen=True)
class Recall:
    """The messages of a drive. Times count from the start of the drive, where it was recorded [s]."""

    recorded: Recorded
    rules: FearRules
    rules_from: str  # origin of the rules, as text
    # rules adopted later, and the decided_s after which they apply
    changes: tuple[tuple[float, FearRules], ...] = ()

    @cached_property
    def zero_s(self) -> float:
        """The recorder's clock at t = 0: the start of the drive, else the first message."""
        began_s = self.recorded.began_s
        return self.recorded.first_s if began_s is None else began_s

    @cached_property
    def decisions(self) -> list[Decision]:
        """Every decision, in order."""
        return [decision for _, decision in self.recorded.of(DECISION)]

    @cached_property
    def t_s(self) -> Column:
        """Arrival time of each decision, shape (n,)."""
        return np.array([at_s - self.zero_s for at_s, _ in self.recorded.of(DECISION)])

    @cached_property
    def cap_mps(self) -> Column:
        """The speed that each decision allows, shape (n,)."""
        return np.array([decision.speed_cap_mps for decision in self.decisions])

    @cached_property
    def speed_mps(self) -> Column:
        """The speed of the vehicle at each decision, shape (n,); NaN before its first report."""
        return self._latest_of(VEHICLE_STATE, "speed_mps")

    @cached_property
    def accel_mps2(self) -> Column:
        """The acceleration commanded at each decision, shape (n,)."""
        return self._latest_of(COMMAND, "accel_mps2")

    @cached_property
    def cruise_mps(self) -> float:
        """The speed cap without fear: where no vehicle ahead limits it, cap = cruise speed times speed factor."""
        ratios = [d.speed_cap_mps / d.speed_factor for d in self.decisions if d.speed_factor > 0.05]
        return max(ratios, default=0.0)

    def rules_of(self, decision: Decision) -> FearRules:
        """The rules of ``decision``: they may change during a drive."""
        newest = [rules for from_s, rules in self.changes if from_s < decision.decided_s]
        return newest[-1] if newest else self.rules

    def index_at(self, t_s: float) -> int:
        """The last decision by ``t_s``; the first one before it."""
        return max(0, bisect_right(self.t_s, t_s + 1e-9) - 1)

    def state_at(self, index: int) -> VehicleState | None:
        """The newest report of the vehicle when decision ``index`` was made."""
        return self._newest(VEHICLE_STATE, index)

    def estimates_at(self, index: int) -> dict[str, SteeringEstimate]:
        """The newest estimate of every estimator that had one when decision ``index`` was made."""
        names = sorted(key.split("/")[1] for key in self.recorded.messages if key.endswith("/estimate"))
        newest = {name: self._newest(estimate_topic(name), index) for name in names}
        return {name: estimate for name, estimate in newest.items() if estimate is not None}

    def estimates_of(self, frame: CompressedFrame) -> dict[str, SteeringEstimate]:
        """The estimates from ``frame``."""
        return {
            key.split("/")[1]: estimate
            for key, arrived in sorted(self.recorded.messages.items())
            if key.endswith("/estimate")
            for _, estimate in arrived
            if abs(estimate.t_s - frame.t_s) < 1e-6
        }

    def frame_at(self, index: int) -> CompressedFrame | None:
        """The camera image of decision ``index``, or the last one before; None without a recent one."""
        at_s = self.recorded.of(DECISION)[index][0]
        seen = read_recording(
            self.recorded.path, CAMERA_COMPRESSED.key, from_s=at_s - _FRAME_WITHIN_S, to_s=at_s
        ).of(CAMERA_COMPRESSED)
        taken_s = self.decisions[index].t_s
        frames = [frame for _, frame in seen if taken_s is None or frame.t_s <= taken_s + 1e-6]
        return frames[-1] if frames else None

    def repeats(self, index: int) -> bool:
        """Whether the rules reproduce the fear of decision ``index``."""
        decision = self.decisions[index]
        values = dict(zip(decision.inputs, decision.input_values, strict=True))
        fear = self.rules_of(decision).evaluate(values).fear
        return bool(values) and math.isclose(fear, decision.fear, abs_tol=1e-9)

    def _newest(self, topic: Any, index: int) -> Any:
        arrived = self.recorded.of(topic)
        found = bisect_right(arrived, self.recorded.of(DECISION)[index][0] + 1e-9, key=lambda entry: entry[0])
        return arrived[found - 1][1] if found else None

    def _latest_of(self, topic: Any, name: str) -> Column:
        """A field of the newest message of ``topic`` at each decision; NaN where there is none."""
        arrived = self.recorded.of(topic)
        values = [math.nan, *(getattr(message, name) for _, message in arrived)]
        found = np.searchsorted([at_s - self.zero_s for at_s, _ in arrived], self.t_s + 1e-9, side="right")
        return np.array(values, dtype=np.float64)[found]  # None becomes NaN


def recall(path: Path, rules: Path | None = None) -> Recall:
    """The drive in the recording at ``path``, with the rules that it carries, or those in ``rules``.

    Raises InputError when there is no decision in it.
    """
    recorded = read_recording(path, *_KEYS)
    if not recorded.of(DECISION):
        short = "" if recorded.complete else "; the file is cut short"
        raise InputError(f"{path}: the recording contains no decision of a supervisor{short}")
    if rules is not None:
        return Recall(recorded, FearRules.load(rules), str(rules))
    attached = recorded_rules(recorded)
    if attached is None:
        shipped = default_file(RULES_NAME)
        return Recall(recorded, FearRules.load(shipped), f"{shipped.name} as it is now (none was recorded)")
    changes = tuple(rule_changes(recorded, path))
    since = f", changed {len(changes)} times during the drive" if changes else ""
    name, data = attached
    return Recall(recorded, attached_rules(data, path), f"{name}, as recorded{since}", changes)


def recorded_rules(recorded: Recorded) -> tuple[str, bytes] | None:
    """Name and bytes of the rule file that the drive began with; None where none was recorded."""
    attached = (file for file in recorded.files.items() if not file[0].startswith(CAR_FILES))
    return next((file for file in attached if file[0].endswith(".yaml")), None)


def rule_changes(recorded: Recorded, path: Path) -> Iterator[tuple[float, FearRules]]:
    """The times at which the supervisor adopted other rules, and these rules. Raises InputError."""
    for _, diagnostic in recorded.of(DIAGNOSTICS):
        values = dict(diagnostic.values)
        if TEXT in values and FROM_S in values:
            yield float(values[FROM_S]), attached_rules(values[TEXT].encode(), path)


def attached_rules(data: bytes, path: Path) -> FearRules:
    """Rules from the bytes of a file. Raises InputError."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / RULES_NAME
        file.write_bytes(data)
        try:
            return FearRules.load(file)
        except InputError as error:
            what = str(error).removeprefix(f"{file}:")
            raise InputError(f"{path}: its rules do not fit this version: {what} (--rules FILE)") from error
