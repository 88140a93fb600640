"""The card of a data set: what it holds, how good it is, and what to do about it.

Which roads it shows is the answer of the estimator ``cv`` on some of its frames.
"""

import math
from collections import Counter
from typing import Any

import numpy as np

from learning.dataset.cleaning import BRIGHT, DARK, frozen_pieces, pieces
from learning.dataset.dataset import NONE, SPLITS, Dataset, Rows, middle_rows
from learning.dataset.likeness import STILL
from learning.dataset.motion import Delay, delay_of, suspicious
from learning.dataset.route_camera import route_camera
from learning.dataset.split import without_steering
from perception.estimators import Estimator, entry_of
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame
from trepid.types import Column

LOOKED_AT = 240  # frames, evenly in time
ESTIMATOR = "cv"
MARKED, EDGES, NEITHER = "lane lines", "edges alone", "neither"


def road_kinds(dataset: Dataset, rows: Rows) -> dict[str, float] | None:
    """Shares of the frames with lane lines, with edges of the road alone, and with neither; None without frames.

    The camera is calibrated by the frames of each route, and every frame is judged on its own.
    """
    if not len(rows):
        return None
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, LOOKED_AT).astype(int))]
    counts = dict.fromkeys((MARKED, EDGES, NEITHER), 0)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    for route in dict.fromkeys(rows["route"].tolist()):
        of_route = rows[rows["route"] == route]
        camera = route_camera(dataset, of_route)
        for row, image in zip(of_route, dataset.images(of_route), strict=True):
            cv: Estimator = entry_of(ESTIMATOR).build(camera, vehicle, assumed=True)
            found = cv.step(Frame(t_s=float(row["t_s"]), image=image), None, now_s=float(row["t_s"]))
            counts[{True: MARKED, False: EDGES, None: NEITHER}[found.marked]] += 1
    return {kind: count / len(rows) for kind, count in counts.items()}


STRAIGHT_DEG, SHARP_DEG = 1.0, 8.0
BINS = 15
LATE_S = 0.05
HIGHEST_HZ = 1000.0  # of a camera
MOST_STRAIGHT, MOST_ONE_SIDED = 0.7, 0.75
LEAST_MINUTES = 5.0
NAMED = 10


def card_of(dataset: Dataset) -> dict[str, Any]:
    """The card as JSON: counts, distribution of the labels, light, likeness, delay, suspicious labels, findings.

    Drives, labels and light are those of the middle camera, whose labels were recorded.
    """
    rows = dataset.rows()
    drive = middle_rows(rows)
    used = drive[drive["split"] != NONE]
    delay, bad, still = delay_of(rows), suspicious(rows), frozen_pieces(rows)
    angles = np.degrees(used["road_wheel_rad"])
    card = {
        "frames": len(rows),
        "splits": {name: int((rows["split"] == name).sum()) for name in (*SPLITS, NONE)},
        "left_out": {why: count for why, count in Counter(rows["why"].tolist()).most_common() if why},
        "side_frames": int((rows["split"] != NONE).sum()) - len(used),
        "routes": dict(Counter(drive["route"].tolist())),
        "stretches": len(set(drive["stretch"].tolist())),
        "duration_s": _duration_s(drive),
        "time_runs_back": int(
            ((np.diff(drive["t_s"]) < 0) & (drive["route"][1:] == drive["route"][:-1])).sum()
        ),
        "rate_hz": _rate_hz(drive),
        "size": _size(dataset, used),
        "speed_mps": _range(used["speed_mps"]),
        "wheel": dataset.wheel.model_dump(mode="json"),
        "angle": _angles(angles),
        "light": _light(used),
        "road": road_kinds(dataset, used),
        "still_share": float((used["change"] <= STILL).mean()) if len(used) else None,
        "repeated_views": int(len(used) - len(np.unique(used["hash"]))),
        "frozen": still,
        "delay": {"delay_s": delay.delay_s, "correlation": delay.correlation, "by": delay.by},
        "suspicious": {"frames": int(bad.sum()), "pieces": pieces(rows, bad)},
        "data_sha256": dataset.sha256,
    }
    card["findings"] = _findings(dataset, card, delay)
    return card


def count_phrase(count: int, noun: str, nouns: str = "") -> str:
    """``count`` and the noun in the right number."""
    return f"{count} {noun if count == 1 else nouns or f'{noun}s'}"


def _duration_s(rows: Rows) -> float:
    step_s = np.diff(rows["t_s"])
    return float(step_s[(rows["stretch"][1:] == rows["stretch"][:-1]) & (step_s > 0)].sum())


def _rate_hz(rows: Rows) -> float | None:
    step_s = np.diff(rows["t_s"])[rows["stretch"][1:] == rows["stretch"][:-1]]
    step_s = step_s[step_s > 0]
    return float(1.0 / np.median(step_s)) if len(step_s) else None


def _size(dataset: Dataset, used: Rows) -> list[int] | None:
    if not len(used):
        return None
    height, width = dataset.image(used[0]).shape[:2]
    return [width, height]


def _range(values: Column) -> dict[str, float] | None:
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    low, middle, high = (float(value) for value in np.percentile(known, (5, 50, 95)))
    return {"p5": low, "median": middle, "p95": high}


def _angles(angles_deg: Column) -> dict[str, Any] | None:
    """Distribution of the labels [deg]."""
    if not len(angles_deg):
        return None
    most = max(float(np.percentile(np.abs(angles_deg), 99.9)), STRAIGHT_DEG)
    counts, edges = np.histogram(np.clip(angles_deg, -most, most), bins=BINS, range=(-most, most))
    turning = np.abs(angles_deg) > STRAIGHT_DEG
    return {
        "mean_deg": float(angles_deg.mean()),
        "std_deg": float(angles_deg.std()),
        "largest_deg": float(np.abs(angles_deg).max()),
        "straight_share": float((~turning).mean()),
        "zero_share": float((angles_deg == 0.0).mean()),
        "sharp_share": float((np.abs(angles_deg) > SHARP_DEG).mean()),
        "left_share": float((angles_deg[turning] > 0).mean()) if turning.any() else None,
        "edges_deg": [round(float(edge), 3) for edge in edges],
        "counts": counts.tolist(),
    }


def _light(used: Rows) -> dict[str, float] | None:
    light = used["light"][np.isfinite(used["light"])]
    if not len(light):
        return None
    return {
        "mean": float(light.mean()),
        "std": float(light.std()),
        "dark_share": float((light < DARK).mean()),
        "bright_share": float((light > BRIGHT).mean()),
    }


def _findings(dataset: Dataset, card: dict[str, Any], delay: Delay) -> list[dict[str, str]]:
    """What is worth a look, and the remedy."""
    found: list[tuple[str, str]] = []
    angle, light = card["angle"], card["light"]
    if angle and angle["straight_share"] > MOST_STRAIGHT:
        share = f"{100 * angle['straight_share']:.0f} % of the frames are straight ahead"
        found.append((share, "train with --set balance=0.5, or record more bends"))
    if (
        angle
        and angle["left_share"] is not None
        and not 1 - MOST_ONE_SIDED < angle["left_share"] < MOST_ONE_SIDED
    ):
        left = f"{100 * angle['left_share']:.0f} % of the bends are to the left"
        found.append((left, "record the other direction too, or train with mirrored images"))
    rows = middle_rows(dataset.rows())
    for split in SPLITS:
        angles = rows["road_wheel_rad"][rows["split"] == split]
        if without_steering(angles[np.isfinite(angles)]):
            flat = f"the angles of the {split} frames hardly vary: any constant fits them"
            found.append((flat, "record bends to both sides; with several drives build with --split route"))
    if card["duration_s"] < 60 * LEAST_MINUTES:
        found.append((f"only {card['duration_s'] / 60:.1f} min of driving", "record more"))
    if light and light["dark_share"] + light["bright_share"] > 0.1:
        share = (
            f"{100 * (light['dark_share'] + light['bright_share']):.0f} % of the images are dark or bright"
        )
        found.append((share, "check the exposure, or build again with --leave-out dark --leave-out bright"))
    if card["rate_hz"] and card["rate_hz"] > HIGHEST_HZ:
        found.append((f"{card['rate_hz']:.0f} frames a second", "check the unit of the times"))
    if card["time_runs_back"]:
        found.append((f"time runs back ({card['time_runs_back']} ×)", "sort the log by time"))
    if card["frozen"]:
        seconds = sum(piece["duration_s"] for piece in card["frozen"])
        found.append(
            (
                f"{len(card['frozen'])} frozen pieces, {seconds:.1f} s",
                "build again with --leave-out frozen",
            )
        )
    found += _about_labels(dataset, card, delay)
    return [{"finding": finding, "remedy": remedy} for finding, remedy in found]


def _about_labels(dataset: Dataset, card: dict[str, Any], delay: Delay) -> list[tuple[str, str]]:
    found = []
    if delay.correlation is not None and delay.delay_s is not None:
        if delay.correlation < 0:
            found.append((f"the labels are opposite to the {delay.by}", "build again with the other --sign"))
        if delay.delay_s < -LATE_S:
            late = f"the labels come {-delay.delay_s:.2f} s after the {delay.by}"
            found.append((late, "check the clocks of camera and steering"))
    if card["suspicious"]["frames"]:
        first = card["suspicious"]["pieces"][0]
        text = f"{card['suspicious']['frames']} labels contradict the {delay.by}"
        found.append(
            (
                text,
                f"look at {first['image']} ({first['route']}, frame {first['frame']}) and the others, or build"
                " again with --leave-out suspicious",
            )
        )
    if dataset.wheel.how.startswith("assumed"):
        found.append(("the lock angle is assumed", "give --lock-deg or --car; degrees scale with it"))
    if dataset.wheel.k_us == 0.0 and any(source.kind != "recording" for source in dataset.file.sources):
        found.append(("understeer was not removed", "give --car, and a log with the speed"))
    if len(card["routes"]) == 1:
        found.append(("one route only: the test is the same road", "record another route for --split route"))
    for source in dataset.file.sources:
        if source.licence and "unknown" in source.licence.lower():
            found.append((f"{source.path}: {source.licence}", "ask its authors"))
    return found


def as_text(card: dict[str, Any]) -> list[str]:
    """The card as lines."""
    angle, light, delay, wheel = card["angle"], card["light"], card["delay"], card["wheel"]
    size = "×".join(map(str, card["size"])) if card["size"] else "none"
    rate = f"{card['rate_hz']:.1f} Hz" if card["rate_hz"] else "no rate"
    lines = [
        f"frames      {card['frames']}: " + ", ".join(f"{name} {n}" for name, n in card["splits"].items()),
        f"drives      {count_phrase(len(card['routes']), 'route')},"
        f" {count_phrase(card['stretches'], 'stretch', 'stretches')}, {card['duration_s']:.0f} s,"
        f" {rate}, {size} pixels",
        *(f"left out    {count} {why}" for why, count in card["left_out"].items()),
    ]
    if card["side_frames"]:
        lines.append(
            f"sides       {card['side_frames']} frames of side cameras train too, and are in no line below"
        )
    lock = f"{math.degrees(wheel['lock_rad']):.1f}° at full lock, " if wheel["lock_rad"] else ""
    understeer = (
        f"understeer of {wheel['k_us']:g} rad/(m/s²) removed" if wheel["k_us"] else "no understeer removed"
    )
    lines.append(f"wheel       {lock}{wheel['how']}; {understeer}")
    if card["speed_mps"]:
        speed = card["speed_mps"]
        lines.append(f"speed       {speed['median']:.1f} m/s median, {speed['p5']:.1f} to {speed['p95']:.1f}")
    if angle:
        lines += _bars(angle)
    if light:
        lines.append(
            f"light       {light['mean']:.2f} ± {light['std']:.2f}, dark {100 * light['dark_share']:.0f} %,"
            f" bright {100 * light['bright_share']:.0f} %"
        )
    if card["road"]:
        shares = ", ".join(f"{kind} {100 * share:.0f} %" for kind, share in card["road"].items())
        lines.append(f"road        {shares} of {LOOKED_AT} frames at most, by the estimator {ESTIMATOR}")
    lines.append(
        f"likeness    {card['repeated_views']} repeated views, {100 * (card['still_share'] or 0):.1f} % still,"
        f" {len(card['frozen'])} frozen pieces"
    )
    if delay["delay_s"] is None:
        lines.append(f"delay       not measurable by the {delay['by']}")
    else:
        lines.append(
            f"delay       {delay['by']} {delay['delay_s']:+z.2f} s after the label (r = {delay['correlation']:.2f})"
        )
    lines.append(f"suspicious  {card['suspicious']['frames']} labels")
    for piece in card["suspicious"]["pieces"][:NAMED]:
        lines.append(f"            {piece['route']} frame {piece['frame']}, {piece['frames']} frames")
    lines += [f"finding     {entry['finding']}: {entry['remedy']}" for entry in card["findings"]]
    return lines


def _bars(angle: dict[str, Any]) -> list[str]:
    most = max(angle["counts"])
    lines = [
        f"angle       {angle['mean_deg']:+z.2f}° ± {angle['std_deg']:.2f}°, largest {angle['largest_deg']:.1f}°;"
        f" straight {100 * angle['straight_share']:.0f} %, exactly zero {100 * angle['zero_share']:.0f} %,"
        f" sharp {100 * angle['sharp_share']:.0f} %"
    ]
    for number, count in enumerate(angle["counts"]):
        middle = (angle["edges_deg"][number] + angle["edges_deg"][number + 1]) / 2
        lines.append(f"  {middle:+7.1f}°  {'█' * round(40 * count / most):40} {count}")
    return lines
