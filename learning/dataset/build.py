"""``trepid dataset build``: logs of drives to the index of a data set."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learning.dataset.cleaning import clean
from learning.dataset.dataset import (
    CARD,
    NONE,
    SPLITS,
    VERSION,
    Dataset,
    DatasetFile,
    Rows,
    Source,
    Split,
    Wheel,
    as_rows,
    check_place,
    sha256_of,
    write,
)
from learning.dataset.likeness import (
    SMALL,
    STILL,
    ImageMeasurements,
    changes,
    hash_of,
    shift_between,
    small_grey,
    upper_half,
)
from learning.dataset.pictures import PictureReader
from learning.dataset.sides import WayBack, moments, split_sides, with_sides
from learning.dataset.sources.comma import is_comma, read_comma
from learning.dataset.sources.log import Faults, Log, SteeringUnit, licence_beside, sha256_of_files
from learning.dataset.sources.recording import SUFFIX, read_drive
from learning.dataset.sources.table import TableOptions, read_table
from learning.dataset.sources.tub import ANGLE, is_tub, read_tub
from learning.dataset.split import GAP, split_rows, stretches, too_short
from learning.dataset.wheel import WheelOptions, road_wheel_rad, wheel_of
from perception.lane.settings import steering_settings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.loudness import warn
from trepid.types import Column, Floats, Image

UNREADABLE, NO_LABEL, OTHER_SIZE = "image cannot be read", "no steering", "other size of image"
UDACITY_LOG = "driving_log.csv"
BEYOND_LOCK = 1.001  # rounding
Progress = Callable[[int], None]  # number of frames that were measured
Reader = Callable[[Path, Faults, TableOptions], Log]


@dataclass(frozen=True, slots=True)
class BuildOptions:
    """The options of a build."""

    wheel: WheelOptions
    split: Split
    table: TableOptions
    leave_out: tuple[str, ...] = ()  # names of RULES
    command: str = ""


def read_log(path: Path, faults: Faults, options: TableOptions) -> Log:
    """The log at ``path``, by the reader of its format. Raises InputError."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if is_tub(path):
        return read_tub(path, faults, options.renamed)
    if path.suffix.lower() == SUFFIX:
        return read_drive(path, faults)
    if is_comma(path):
        return read_comma(path)
    if path.is_dir() and (path / UDACITY_LOG).is_file():
        return read_table(path / UDACITY_LOG, faults, options)
    if path.suffix.lower() == ".csv":
        return read_table(path, faults, options)
    raise InputError(
        f"{path}: no known log of a drive; known: a recording (.mcap), a donkeycar tub, a segment or route of"
        f" comma2k19, a folder with {UDACITY_LOG}, a table (.csv)"
    )


def read_logs(paths: list[Path], faults: Faults, options: TableOptions) -> list[Log]:
    """The logs of all sources, with a name of its own for every route; side cameras follow their middle one."""
    logs = [read_log(path, faults, options) for path in paths]
    names = Counter(name for log in logs for name in set(log.route))
    for number, log in enumerate(logs):
        log.route = [f"{name}#{number}" if names[name] > 1 else name for name in log.route]
    if options.side_camera_m is None:
        return logs
    return [one for log in logs for one in with_sides(log, options.side_camera_m)]


def built_once(out: Path, paths: list[Path], split: Split) -> Dataset:
    """The data set ``out`` of complete logs of this car, built where it is missing. Raises InputError."""
    if not (out / CARD).is_file():
        faults = Faults(strict=True)
        logs = read_logs(paths, faults, TableOptions())
        build(out, logs, BuildOptions(WheelOptions(), split, TableOptions()), faults)
    return Dataset.open(out)


def build(
    out: Path, logs: list[Log], options: BuildOptions, faults: Faults, progress: Progress = lambda _: None
) -> DatasetFile:
    """Label, measure and divide the frames of ``logs``, and write the data set. Raises InputError."""
    check_place(out)
    _check_options(logs, options)
    middle_logs = [log for log in logs if not log.camera_left_m]
    wheel = wheel_of(middle_logs, options.wheel)
    for log in middle_logs:
        _name_steps_back(log, faults)
        _check_steering(log, faults)
    t_s = np.concatenate([log.t_s for log in logs])
    route = np.array([name for log in logs for name in log.route])
    stretch = stretches(t_s, route)
    angle_rad = _labels(logs, wheel)
    unusable, look = _measure_images(logs, stretch, faults, progress)
    columns = {
        "frame": _row_numbers(route),
        "source": np.repeat(np.arange(len(logs)), [len(log) for log in logs]),
        "image": [name for log in logs for name in log.image],
        "item": np.concatenate([log.item for log in logs]),
        "t_s": t_s,
        "route": route,
        "stretch": stretch,
        "road_wheel_rad": angle_rad,
        "speed_mps": np.concatenate([log.speed_mps for log in logs]),
        "split": np.where(unusable == "", SPLITS[0], NONE),
        "why": unusable,
        "light": look.light,
        "hash": look.hash,
        "change": look.change,
        "shift": look.shift,
        "yaw_rate_radps": np.concatenate([log.yaw_rate_radps for log in logs]),
        "camera_left_m": np.repeat([log.camera_left_m for log in logs], [len(log) for log in logs]),
    }
    unusable = clean(as_rows(columns), options.leave_out)
    moment = moments(logs)
    middle = moment == np.arange(len(moment))
    split, why = np.where(unusable == "", SPLITS[0], NONE).astype("<U10"), unusable.astype("<U64")
    if short := too_short(options.split, t_s[middle], route[middle], unusable[middle]):
        warn(
            f"trepid: {short}; all frames are in the split {SPLITS[0]}, and nothing is left to judge a network by:"
            " a longer drive, or a smaller --gap-s, leaves some"
        )
    else:
        split[middle], why[middle] = split_rows(
            options.split, t_s[middle], route[middle], unusable[middle], look.of(middle)
        )
    split_sides(split, why, moment, look)
    rows = as_rows(columns | {"split": split, "why": why})
    if not short:
        _check_splits(options.split, rows)
    file = DatasetFile(
        version=VERSION,
        sources=tuple(_source(log) for log in logs),
        wheel=wheel,
        split=options.split,
        leave_out=options.leave_out,
        command=options.command,
        data_sha256=sha256_of(rows),
    )
    write(out, file, rows)
    return file


def _labels(logs: list[Log], wheel: Wheel) -> Column:
    """The road-wheel angles of all rows [rad], those of side cameras with the way back. Raises InputError."""
    found: list[Column] = []
    recorded_rad = np.empty(0)
    for log in logs:
        if not log.camera_left_m:
            recorded_rad = road_wheel_rad(log, wheel)
            found.append(recorded_rad)
            continue
        if wheel.wheelbase_m is None:
            raise InputError(
                f"{log.path}: the way back from a side camera needs the wheelbase: give --wheelbase-m or --car"
            )
        ahead_m = steering_settings().lookahead_m * load(CONFIG_DIR / "vehicle.yaml", Vehicle).scale
        found.append(WayBack(ahead_m, wheel.wheelbase_m, wheel.lock_rad).correct(log, recorded_rad))
        side = "left" if log.camera_left_m > 0 else "right"
        log.notes.append(
            f"{side} camera, {abs(log.camera_left_m):g} m from the middle, for training alone: its angles lead back"
            f" to the recorded path {ahead_m:g} m ahead"
        )
    return np.concatenate(found)


def _check_splits(rule: Split, rows: Rows) -> None:
    """Raise InputError when a split that should have rows has none."""
    for name, share in rule.shares.items():
        if share > 0 and not (rows["split"] == name).any():
            reasons = Counter(rows["why"][rows["why"] != ""].tolist())
            causes = [f"{count} left out: {why}" for why, count in reasons.most_common(2)]
            still = int((rows["change"] <= STILL).sum())
            if 2 * still > len(rows):
                causes.append(f"{still} pictures are as the one before: the camera hung, or the car stood")
            back = (np.diff(rows["t_s"]) < 0) & (rows["route"][1:] == rows["route"][:-1])
            if back.any():
                causes.append(f"time runs back ({back.sum()} ×): sort the log by time")
            gap = f"with a gap of {rule.gap_s:g} s (--gap-s)"
            if GAP in reasons:
                causes.append("a longer drive, or a smaller gap, leaves some")
            raise InputError("; ".join([f"no row of {len(rows)} is left for {name} {gap}", *causes]))


def _check_options(logs: list[Log], options: BuildOptions) -> None:
    """Raise InputError for an option that no source uses."""
    kinds, units = {log.kind for log in logs}, {log.unit for log in logs}
    table, wheel = options.table, options.wheel
    tubs = bool(kinds & {"tub1", "tub2"})
    no_side = "no table names images of a left or a right camera"
    no_table, no_wheel = "no source is a table", "the logs hold no angles of a steering wheel"
    uses = (  # option, its value, whether a source uses it, and why not
        ("--column", table.renamed, "table" in kinds or (tubs and set(table.renamed) == {ANGLE}), no_table),
        ("--fps", table.fps, "table" in kinds, no_table),
        ("--video", table.video, "table" in kinds, no_table),
        ("--side-camera-m", table.side_camera_m, any(log.camera_left_m for log in logs), no_side),
        ("--test-route", options.split.test_routes, options.split.by == "route", "needs --split route"),
        ("--lock-deg", wheel.lock_deg, SteeringUnit.LOCK in units, "the logs hold angles"),
        ("--steering-ratio", wheel.ratio, SteeringUnit.WHEEL in units, no_wheel),
    )
    for name, value, used, why in uses:
        if value and not used:
            raise InputError(f"{name}: {why}")


def _name_steps_back(log: Log, faults: Faults) -> None:
    """Name the first row from which the time of a route runs back, and the number of these rows."""
    route = np.array(log.route)
    rows = [np.flatnonzero(route == name) for name in np.unique(route)]
    back = np.sort(np.concatenate([mine[1:][np.diff(log.t_s[mine]) < 0] for mine in rows]))
    if len(back):
        more = f", and {len(back) - 1} × more" if len(back) > 1 else ""
        what = "a clock that was set, or rows in another order"
        faults(
            f"{log.place(int(back[0]))}: time runs back{more}: {what}",
            rows=0,
            remedy="the drive counts as divided there",
        )


def _check_steering(log: Log, faults: Faults) -> None:
    """Name the rows without steering, and those beyond full lock."""
    for number in np.flatnonzero([not reason for reason in log.why]).tolist():
        value = log.steering[number]
        beyond = log.unit == SteeringUnit.LOCK and abs(value) > BEYOND_LOCK
        if math.isfinite(value) and not beyond:
            continue
        what = f"steering of {value:g} is beyond full lock" if beyond else "no steering"
        faults(f"{log.place(number)}: {what}")
        log.why[number] = NO_LABEL
        log.steering[number] = math.nan


def _row_numbers(route: NDArray[np.str_]) -> NDArray[np.int64]:
    """Number of each row within its route."""
    frame = np.empty(len(route), np.int64)
    for name in np.unique(route):
        mine = np.flatnonzero(route == name)
        frame[mine] = np.arange(len(mine))
    return frame


def _measure_images(
    logs: list[Log], stretch: NDArray[np.int32], faults: Faults, progress: Progress
) -> tuple[NDArray[np.str_], ImageMeasurements]:
    """Read every image once: the reasons to leave out rows, and the look of all rows."""
    total = len(stretch)
    small = np.zeros((total, SMALL[1], SMALL[0]), np.uint8)
    light, shift = (np.full(total, np.nan, np.float32) for _ in range(2))
    hashes = np.zeros(total, np.uint64)
    why: list[str] = []
    for log in logs:
        reasons, sizes, first = list(log.why), {}, len(why)
        before: Floats | None = None  # the upper half of the image before
        for number, image in enumerate(_images(log, faults)):
            at = first + number
            progress(at + 1)
            if image is None:
                reasons[number], before = reasons[number] or UNREADABLE, None
                continue
            sizes[number] = image.shape[:2]
            small[at], hashes[at], upper = small_grey(image), hash_of(image), upper_half(image)
            light[at] = small[at].mean() / 255.0
            if before is not None and stretch[at] == stretch[at - 1]:
                shift[at] = shift_between(before, upper)
            before = upper
        _leave_out_other_sizes(log, sizes, reasons, faults)
        why += reasons
    look = ImageMeasurements(light, hashes, small, changes(small, stretch, np.isfinite(light)), shift)
    return np.array(why), look


def _images(log: Log, faults: Faults) -> Iterator[Image | None]:
    """The images of a log in order; None without one, and where it cannot be read, which ``faults`` gets."""
    with closing(PictureReader(log.root, log.topic)) as pictures:
        for name, item in zip(log.image, log.item.tolist(), strict=True):
            try:
                yield pictures.read(name, item) if name else None
            except InputError as error:
                faults(str(error))
                yield None


def _leave_out_other_sizes(
    log: Log, sizes: Mapping[int, tuple[int, ...]], reasons: list[str], faults: Faults
) -> None:
    """Leave out images of another size than most of the log have."""
    if not sizes:
        raise InputError(f"{log.path}: no image of this log can be read; they are sought below {log.root}")
    usual = Counter(sizes.values()).most_common(1)[0][0]
    for number, size in sizes.items():
        if size != usual:
            faults(
                f"{log.root / log.image[number]}: {size[1]}×{size[0]} pixels, the others {usual[1]}×{usual[0]}"
            )
            reasons[number] = reasons[number] or OTHER_SIZE


def _source(log: Log) -> Source:
    return Source(
        kind=log.kind,
        path=log.path.resolve(),
        root=log.root.resolve(),
        sha256=sha256_of_files(log.files),
        rows=len(log) + log.unread,
        unread=log.unread,
        topic=log.topic,
        licence=licence_beside(log.path if log.path.is_dir() else log.path.parent),
        notes=tuple(log.notes),
    )
