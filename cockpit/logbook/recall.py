"""A recorded drive from the side of the supervisor: its decisions, its inputs and its rules."""

import math
import struct
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property, wraps
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Concatenate, ParamSpec, TypeVar

import numpy as np
from pydantic import BaseModel

from drive.reason import reason
from supervisor.rules.inference import FearRules
from trepid.car.vehicle import Corridor
from trepid.config import CONFIG_DIR, InputError, default_file, parse, read
from trepid.loudness import note
from trepid.messages import (
    CompressedFrame,
    Decision,
    Diagnostic,
    ImageStatistics,
    SteeringEstimate,
    VehicleState,
)
from trepid.recording.images import recorded_settings
from trepid.recording.notes import RULES, RULES_FROM_S
from trepid.recording.reader import RecordingContent, Series, read_recording, read_series
from trepid.recording.writer import rules_name
from trepid.topics import (
    CAMERA_COMPRESSED,
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    IMAGE_STATISTICS,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)
from trepid.types import Column
from trepid.wire import VEHICLE_FRAME, WireError

P = ParamSpec("P")
A = TypeVar("A")
RULES_NAME = "fear.yaml"
_KEYS = (
    *(topic.key for topic in (DECISION, VEHICLE_STATE, COMMAND, DIAGNOSTICS, IMAGE_STATISTICS)),
    estimate_topic("*").key,
)
_FRAME_WITHIN_S = 1.0  # greatest age of the camera image of a decision
TAIL = struct.Struct("<dd")  # speed_factor and speed_cap_mps, with which the bytes of a decision end
LEAST_BYTES = 200  # of a decision
HEADER_FRAME = struct.pack("<I", len(VEHICLE_FRAME) + 1) + VEHICLE_FRAME.encode() + b"\0"
FRAME_AT = 12  # place of it in CDR: behind 4 bytes of its own, seconds and nanoseconds
MOST_MPS = 200.0  # a faster speed cap is a sign of a malformed decision


class DrivenPlace(BaseModel):
    """What is read of a recorded vehicle file, which may be that of another version."""

    corridor: Corridor = Corridor.LANE


@dataclass(frozen=True)
class Recall:
    """The messages of a drive. Times count from the start of the drive, where it was recorded [s]."""

    recorded: RecordingContent  # without its messages
    series: Mapping[str, Series[Any]]  # the messages by the key of their topic
    rules: FearRules
    rules_from: str  # origin of the rules, as text
    # rules adopted later, and the decided_s after which they apply
    changes: tuple[tuple[float, FearRules], ...] = ()

    @cached_property
    def zero_s(self) -> float:
        """The recorder's clock at t = 0: the start of the drive, else the first message."""
        began_s = self.recorded.began_s
        return self.recorded.first_s if began_s is None else began_s

    @property
    def decisions(self) -> Series[Decision]:
        """Every decision, in order."""
        return self.series[DECISION.key]

    @cached_property
    def corridor(self) -> Corridor:
        """What the recorded car drove in the middle of, by its recorded vehicle file. Raises InputError."""
        place = CONFIG_DIR / "vehicle.yaml"
        with recorded_settings(self.recorded, place.name):
            return parse(read(place), DrivenPlace, source=place).corridor

    def without_undecodable(self) -> "Recall":
        """The drive without the decisions that cannot be decoded. Raises InputError when none is left."""
        decisions = copy(self.decisions)
        _without_malformed(self.recorded, decisions, every=True)
        return replace(self, series={**self.series, DECISION.key: decisions})

    @cached_property
    def t_s(self) -> Column:
        """Arrival time of each decision, shape (n,)."""
        return np.array(self.decisions.at_s) - self.zero_s

    @cached_property
    def cap_mps(self) -> Column:
        """The speed that each decision allows, shape (n,)."""
        return self._factors_and_caps[:, 1]

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
        factors, caps = self._factors_and_caps.T
        return float(np.max(caps[factors > 0.05] / factors[factors > 0.05], initial=0.0))

    @cached_property
    def _factors_and_caps(self) -> Column:
        """Speed factor and speed cap of each decision, shape (n, 2): they are the last two numbers of its bytes."""
        decisions = self.decisions
        if decisions.current:
            tails = b"".join(data[-TAIL.size :] for data in decisions.data)
            return np.frombuffer(tails, "<f8").reshape(-1, 2)
        return np.array([(d.speed_factor, d.speed_cap_mps) for d in decisions])

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

    def decision_sentence(self, index: int) -> str:
        """What the car did at decision ``index`` and why, in a sentence; by the command that followed it."""
        state, after = self.state_at(index), min(index + 1, len(self.decisions) - 1)
        driver = state is not None and bool(state.driver_override)
        return reason(self.decisions[index], command=self._newest(COMMAND, after), driver=driver)

    def statistics_at(self, index: int) -> ImageStatistics | None:
        """The newest statistics of the image when decision ``index`` was made."""
        return self._newest(IMAGE_STATISTICS, index)

    def estimates_at(self, index: int) -> dict[str, SteeringEstimate]:
        """The newest estimate of every estimator that had one when decision ``index`` was made."""
        newest = {name: self._newest(estimate_topic(name), index) for name in self.estimators}
        return {name: estimate for name, estimate in newest.items() if estimate is not None}

    @cached_property
    def estimators(self) -> list[str]:
        """Names of the estimators with a message, in alphabetical order."""
        return sorted(key.split("/")[1] for key in self.series if key.endswith("/estimate"))

    def estimates_of(self, frame: CompressedFrame) -> dict[str, SteeringEstimate]:
        """The estimates from ``frame``, of those that arrived within _FRAME_WITHIN_S of its capture."""
        found: dict[str, SteeringEstimate] = {}
        for name in self.estimators:
            arrived = self.series[estimate_topic(name).key]
            first = bisect_left(arrived.at_s, frame.t_s - _FRAME_WITHIN_S)
            last = bisect_right(arrived.at_s, frame.t_s + _FRAME_WITHIN_S)
            for place in range(first, last):
                estimate = _valid(arrived, place)
                if estimate is not None and abs(estimate.t_s - frame.t_s) < 1e-6:
                    found.setdefault(name, estimate)  # a broken one may follow it
        return found

    def frame_at(self, index: int) -> CompressedFrame | None:
        """The camera image of decision ``index``, or the last one before; None without a recent one."""
        at_s = self.decisions.at_s[index]
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

    def _newest(self, topic: Topic[Any], index: int) -> Any:
        """The newest message of ``topic`` when decision ``index`` was made; None without one."""
        arrived = self.series.get(topic.key)
        if arrived is None:
            return None
        place = bisect_right(arrived.at_s, self.decisions.at_s[index] + 1e-9) - 1
        return _newest_valid(arrived, place)

    def _latest_of(self, topic: Topic[Any], name: str) -> Column:
        """A field of the newest message of ``topic`` at each decision; NaN where there is none."""
        arrived = self.series.get(topic.key)
        if arrived is None:
            return np.full(len(self.decisions), np.nan)
        places = np.searchsorted(arrived.at_s, np.array(self.decisions.at_s) + 1e-9, side="right") - 1
        newest = (_newest_valid(arrived, place) for place in places.tolist())
        return np.array([getattr(one, name, None) for one in newest], dtype=np.float64)  # None becomes NaN


def _newest_valid(arrived: Series[Any], place: int) -> Any:
    """The message at ``place``, or the last valid one before: a malformed message counts as not received."""
    valid = (one for k in range(place, -1, -1) if (one := _valid(arrived, k)) is not None)
    return next(valid, None)


def _valid(arrived: Series[Any], place: int) -> Any:
    """The message at ``place``; None when it was malformed on the bus already."""
    try:
        return arrived[place]
    except WireError:
        return None


def of_valid(question: Callable[Concatenate[Recall, P], A]) -> Callable[Concatenate[Recall, P], A]:
    """``question`` about a drive, asked again without the malformed decisions when it comes upon one.

    :func:`recall` finds most of them. To decode every decision of a long drive takes longer than to read its file.
    """

    @wraps(question)
    def ask(drive: Recall, *args: P.args, **options: P.kwargs) -> A:
        try:
            return question(drive, *args, **options)
        except WireError:
            return question(drive.without_undecodable(), *args, **options)

    return ask


def _without_malformed(
    recorded: RecordingContent, decisions: Series[Decision], *, every: bool = False
) -> None:
    """Drop the decisions that were malformed on the bus, and say so. Raises InputError when none is left.

    Unless ``every`` one is asked for, of those of this version only odd ones are decoded. A decision is odd when it
    does not begin as those of Trepid, or its last two numbers are not a speed factor and a speed.
    """
    kept = []
    for place, data in enumerate(decisions.data):
        odd = (
            every
            or not decisions.current
            or len(data) < LEAST_BYTES
            or not data.startswith(HEADER_FRAME, FRAME_AT)
        )
        if not odd:
            factor, cap_mps = TAIL.unpack_from(data, len(data) - TAIL.size)
            odd = not (0.0 <= factor <= 1.0 and 0.0 <= cap_mps < MOST_MPS)
        if not odd or _valid(decisions, place) is not None:
            kept.append(place)
    malformed = len(decisions) - len(kept)
    decisions.keep(kept)
    if malformed:
        note(f"{recorded.path}: {malformed} malformed decisions count as not received")
    if not kept:
        raise _no_decision(recorded)


def _no_decision(recorded: RecordingContent) -> InputError:
    short = "" if recorded.complete else "; the file is cut short"
    return InputError(f"{recorded.path}: the recording contains no decision of a supervisor{short}")


def recall(path: Path, rules: Path | None = None) -> Recall:
    """The drive in the recording at ``path``, with the rules that it carries, or those in ``rules``.

    Raises InputError when there is no decision in it.
    """
    recorded, series = read_series(path, *_KEYS)
    if DECISION.key not in series:
        raise _no_decision(recorded)
    _without_malformed(recorded, series[DECISION.key])
    if rules is not None:
        return Recall(recorded, series, FearRules.load(rules), str(rules))
    attached = recorded_rules(recorded)
    if attached is None:
        shipped = default_file(RULES_NAME)
        rules_from = f"{shipped.name} as it is now (none was recorded)"
        return Recall(recorded, series, FearRules.load(shipped), rules_from)
    changes = tuple(rule_changes(_diagnostics(series), path))
    since = f", changed {len(changes)} times during the drive" if changes else ""
    name, data = attached
    return Recall(recorded, series, attached_rules(data, path), f"{name}, as recorded{since}", changes)


def _diagnostics(series: Mapping[str, Series[Any]]) -> Iterator[Diagnostic]:
    """The diagnostics that may state a change of rules."""
    if DIAGNOSTICS.key not in series:
        return
    beats = series[DIAGNOSTICS.key]
    for place, data in enumerate(beats.data):
        if RULES_FROM_S.encode() in data and (beat := _valid(beats, place)) is not None:
            yield beat


def recorded_rules(recorded: RecordingContent) -> tuple[str, bytes] | None:
    """Name and bytes of the rule file that the recording began with; None where none was recorded."""
    name = rules_name(recorded.files)
    return None if name is None else (name, recorded.files[name])


def rule_changes(beats: Iterable[Diagnostic], path: Path) -> Iterator[tuple[float, FearRules]]:
    """The times at which the supervisor adopted other rules, and these rules. Raises InputError."""
    for diagnostic in beats:
        values = dict(diagnostic.values)
        if RULES in values and RULES_FROM_S in values:
            yield float(values[RULES_FROM_S]), attached_rules(values[RULES].encode(), path)


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
