"""One inference: time relative to scikit-fuzzy, memory growth, equality across processes.

The rules are those of the target, 8 inputs with 5 sets each and 40 rules, and the shipped file. Points are drawn
from the whole range of every input, where many rules hold, and from its calm end, as on most drives. Times are by
wall clock and by processor time, which depends less on other work on the machine.
"""

import gc
import random
import resource
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from lab.bench.fear.determinism import differing_processes, random_point
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import Point
from supervisor.rules.rule_file import LEVELS, Method, RuleFile
from supervisor.rules.scikit import fear_of, simulation
from supervisor.rules.sentence import parse_rule
from trepid.config import CONFIG_DIR
from trepid.types import Array

INFERENCES, PEER_INFERENCES, MANY = 20_000, 60, 1_000_000
TARGET_US = {"median_us": 30.0, "p99_us": 50.0}
CALM_SHARE = 0.2  # of the range, from the calm end
Spent = tuple[float, float]
"""Wall-clock and processor time [s]."""
EIGHT = (
    *("frame_age", "lane_confidence", "disagreement", "lane_width_error"),
    *("brightness", "over_exposed", "speed", "lateral_error"),
)


def bench_inference(seed: int) -> dict[str, Any]:
    """Times [us], ratio to scikit-fuzzy, agreement of the method mamdani, memory, equality across processes."""
    target, shipped = forty_rules(), FearRules.load(CONFIG_DIR / "fear.yaml")
    rng = random.Random(seed)
    anywhere = [random_point(target, rng) for _ in range(500)]
    rows: dict[str, Any] = {
        "8 inputs, 5 sets, 40 rules": beside_scikit(target, anywhere),
        "the same, calm": times_us(target, [random_point(target, rng, CALM_SHARE) for _ in range(500)]),
        "the same, mamdani": times_us(forty_rules("mamdani"), anywhere),
        "mamdani, greatest difference to scikit-fuzzy": difference(forty_rules("mamdani"), anywhere),
    }
    size = f"shipped file, {len(shipped.inputs)} inputs, {len(shipped.rules)} rules"
    rows[size] = times_us(shipped, [random_point(shipped, rng) for _ in range(500)])
    rows[f"{size}, calm"] = times_us(shipped, [random_point(shipped, rng, CALM_SHARE) for _ in range(500)])
    rows[f"memory over {MANY:.0e} inferences"] = growth(target, anywhere)
    rows["processes that differ"] = differing_processes(seed)
    return rows


def forty_rules(method: Method = "monotone") -> FearRules:
    """Eight inputs of the shipped file and forty rules, two fifths of them with two or three inputs."""
    shipped = FearRules.load(CONFIG_DIR / "fear.yaml").file
    bad = {name: LEVELS if shipped.inputs[name].risk == "rising" else LEVELS[::-1] for name in EIGHT}
    sentences = [
        f"if {' and '.join(f'{name} is {bad[name][0]}' for name in EIGHT[:3])} then fear is very_low"
    ]
    for i, name in enumerate(EIGHT):
        second, third = EIGHT[(i + 1) % 8], EIGHT[(i + 2) % 8]
        sentences += [f"if {name} is {bad[name][k]} then fear is {LEVELS[k]}" for k in (1, 2, 3)]
        sentences.append(f"if {name} is {bad[name][2]} and {second} is {bad[second][2]} then fear is high")
        three = f"{name} is {bad[name][3]} and {second} is {bad[second][2]} and {third} is {bad[third][1]}"
        sentences.append(f"if {three} then fear is very_high")
    file = RuleFile(
        method=method,
        inputs={name: shipped.inputs[name] for name in EIGHT},
        rules=tuple(sentences[:40]),
        fear=shipped.fear,
        hysteresis=shipped.hysteresis,
    )
    return FearRules(file, tuple(parse_rule(sentence, file.inputs) for sentence in file.rules))


def times_us(rules: FearRules, points: list[Point], *, count: int = INFERENCES) -> dict[str, Any]:
    """Median and 99th percentile of one inference [us]."""
    spent = np.empty((count, 2))  # filled in place: a growing list would be measured too
    for i in range(count):
        spent[i] = _time_call(rules.evaluate, points[i % len(points)])
    return _summary(spent)


def beside_scikit(rules: FearRules, points: list[Point]) -> dict[str, Any]:
    """Times, and their ratio to scikit-fuzzy's ControlSystemSimulation, both taking turns.

    Times in turn count for the ratio only, because scikit-fuzzy replaces the contents of the processor's caches.
    """
    row = times_us(rules, points)
    row["target"] = "met" if all(row[name] <= limit for name, limit in TARGET_US.items()) else "missed"
    peer, ours, theirs = simulation(rules), [], []
    for turn in range(PEER_INFERENCES):
        ours += [_time_call(rules.evaluate, point) for point in points[:50]]
        theirs.append(_time_call(fear_of, peer, points[turn % len(points)]))
    row["scikit_fuzzy_median_us"] = _summary(theirs)["median_us"]
    row["ratio"] = round(row["scikit_fuzzy_median_us"] / _summary(ours)["median_us"])
    return row


def difference(rules: FearRules, points: list[Point], *, count: int = 20) -> float:
    """Greatest difference of fear to scikit-fuzzy's with 1001 points a universe, where a rule fires."""
    peer = simulation(rules, places=1001)
    pairs = [(rules.evaluate(point).fear, fear_of(peer, point)) for point in points[:count]]
    return max(abs(ours - theirs) for ours, theirs in pairs if theirs is not None)


def growth(rules: FearRules, points: list[Point], *, count: int = MANY) -> dict[str, int]:
    """Blocks and bytes that ``count`` inferences leave behind, after as many to warm up as there are points."""
    for point in points:
        rules.evaluate(point)
    gc.collect()
    blocks, peak_kib = sys.getallocatedblocks(), _peak_kib()
    for i in range(count):
        rules.evaluate(points[i % len(points)])
    gc.collect()
    left = sys.getallocatedblocks() - blocks
    return {"blocks": left, "peak_memory_kib": _peak_kib() - peak_kib}


def _time_call(call: Callable[..., object], *args: object) -> Spent:
    wall_s, used_s = time.perf_counter(), time.thread_time()
    call(*args)
    used_s = time.thread_time() - used_s
    return time.perf_counter() - wall_s, used_s


def _summary(spent: Sequence[Spent] | Array) -> dict[str, Any]:
    (p50, used50), (p99, used99) = np.percentile(spent, [50, 99], axis=0) * 1e6
    found = {"median_us": p50, "p99_us": p99, "median_cpu_us": used50, "p99_cpu_us": used99}
    return {name: round(float(time_us), 1) for name, time_us in found.items()}


def _peak_kib() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
