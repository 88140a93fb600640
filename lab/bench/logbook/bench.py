"""``trepid bench logbook``: what a recording answers, how fast, and what a crash leaves of it.

Explanations: random moments of random recordings, whole, begun in the middle of a drive, or cut short. Opening: a
recording of half an hour with an image per frame, by wall clock and by the computing time of the process. Crashes:
:mod:`.crash`. Replay: every node again on a rendered drive with raw images.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from cockpit.logbook.recall import recall
from cockpit.logbook.story import story
from cockpit.logbook.story_text import story_text
from cockpit.replay.rerun import rerun
from lab.bench.logbook.crash import cut, kill_writers
from lab.bench.logbook.drives import KINDS, prolong, random_recordings, record_run
from sim_harness.scenarios.scenario import load_scenario
from supervisor.rules.rule_file import LEVELS
from trepid.config import ROOT, InputError

COUNT = 100  # recordings, kills, cuts
MOMENTS = 20  # of each recording
RENDERED_S = 30.0  # length of the rendered drive
LONG_S = 1800.0
OPENINGS = REPLAYS = 3


def bench_logbook(seed: int, count: int = COUNT) -> dict[str, Any]:
    """Tables of explanations, opening, crashes and replay; ``count``: recordings, kills and cuts."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory(prefix="trepid-logbook-") as name:
        folder = Path(name)
        scenario = load_scenario("circuit", {"duration_s": str(RENDERED_S)})
        drive = record_run(scenario, folder / "drive.mcap", seed=1)
        raw = record_run(scenario, folder / "raw.mcap", seed=1, raw_images=True)
        long = prolong(drive, folder / "long.mcap", LONG_S)
        return {
            "explain": measure_answers(folder, count, rng),
            "open": measure_start(long),
            "killed": kill_writers(drive, folder, count, rng),
            "cut": cut(prolong(drive, folder / "minutes.mcap", 0.1 * LONG_S), folder, count, rng),
            "replay": measure_replay(raw),
        }


def measure_answers(folder: Path, count: int, rng: np.random.Generator) -> dict[str, Any]:
    """Share of random moments that have an answer, and the time of one, by kind of recording.

    The moments of a recording that is not readable have none.
    """
    asked = {kind: [0, 0] for kind in KINDS}  # moments, answers
    calm, unreadable, times_ms = 0, 0, []
    for kind, path in random_recordings(folder, count, rng):
        try:
            drive = recall(path)
        except InputError:
            unreadable += 1
            asked[kind][0] += MOMENTS
            continue
        first_s, last_s = (at_s - drive.zero_s for at_s in (drive.recorded.first_s, drive.recorded.last_s))
        for at_s in rng.uniform(first_s, last_s, MOMENTS).tolist():
            began_s = time.perf_counter()
            try:
                answer = story(drive, at_s)
                good = bool(story_text(answer)) and answer["level"] in LEVELS and answer["repeats"]
            except (InputError, ValueError):
                good = False
            times_ms.append(1e3 * (time.perf_counter() - began_s))
            asked[kind][0] += 1
            asked[kind][1] += good
            calm += good and answer["slowed_by"] is None
    moments, answers = map(sum, zip(*asked.values(), strict=True))
    return {
        "recordings": count,
        "not readable": unreadable,
        "moments": moments,
        "answered [%]": round(100.0 * answers / moments, 2),
        **{f"answered, {kind} recordings [%]": _percent(*asked[kind]) for kind in KINDS},
        "calm moments [%]": round(100.0 * calm / moments, 1),
        "time of an answer, median [ms]": round(float(np.median(times_ms)), 1) if times_ms else None,
        "time of an answer, most [ms]": round(max(times_ms), 1) if times_ms else None,
    }


def _percent(asked: int, answered: int) -> float | None:
    return round(100.0 * answered / asked, 2) if asked else None


def measure_start(path: Path) -> dict[str, Any]:
    """Times from the start of ``trepid fear explain --at`` to its end, and of its parts in this process."""
    walls_s, used_s, verbs_s = [], [], []
    head = recall(path).recorded
    middle_s = (head.last_s - head.first_s) / 2
    for _ in range(OPENINGS):
        wall_s, process_s = time.perf_counter(), time.process_time()
        drive = recall(path)
        story(drive, middle_s)
        walls_s.append(time.perf_counter() - wall_s)
        used_s.append(time.process_time() - process_s)
        verbs_s.append(_verb_s(path, middle_s))
    return {
        "length [s]": round(drive.recorded.last_s - drive.recorded.first_s),
        "size [MB]": round(path.stat().st_size / 1e6, 1),
        "decisions": len(drive.decisions),
        "open and explain, wall clock, median [s]": round(float(np.median(walls_s)), 2),
        "open and explain, computing time, median [s]": round(float(np.median(used_s)), 2),
        "the whole verb, wall clock, median [s]": round(float(np.median(verbs_s)), 2),
    }


def _verb_s(path: Path, at_s: float) -> float:
    """Wall-clock time of the verb. Raises RuntimeError when it gives no answer."""
    words = [sys.executable, "-m", "trepid", "fear", "explain", str(path), "--at", str(at_s), "--json"]
    began_s = time.perf_counter()
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    lasted_s = time.perf_counter() - began_s
    if done.returncode != 0 or "fear" not in json.loads(done.stdout):
        raise RuntimeError(f"trepid fear explain: {done.stderr}")
    return lasted_s


def measure_replay(path: Path) -> dict[str, Any]:
    """Differences of a replay through all nodes, and its factors of real time, the median of REPLAYS."""
    lasted_s = []
    for _ in range(REPLAYS):
        began_s = np.array(_clocks())
        found = rerun(path, ["all"])
        lasted_s.append(np.array(_clocks()) - began_s)
    wall, used = (found.drive_s / np.median(lasted_s, axis=0)).round(2).tolist()
    return {
        "length [s]": round(found.drive_s, 1),
        "nodes": len(found.topics),
        "outputs compared": sum(topic.compared for topic in found.topics.values()),
        "outputs that differ": found.differences,
        "times real time, wall clock": wall,
        "times real time, computing time of both processes": used,
    }


def _clocks() -> tuple[float, float]:
    """Wall clock, and computing time of this process and those that it has ended [s]."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.perf_counter(), time.process_time() + children.ru_utime + children.ru_stime
