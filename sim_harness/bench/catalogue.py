"""The table of benchmarks: ``trepid bench NAME``. A benchmark is imported when it runs."""

import importlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim_harness.bench.perception.options import PerceptionOptions

PERCEPTION = "perception"  # the benchmark with options of its own
HERE = "sim_harness.bench"


@dataclass(frozen=True, slots=True)
class Benchmark:
    """A benchmark function, as ``module:function`` below ``sim_harness.bench``, and its requirements."""

    source: str
    summary: str  # one line for `trepid bench --list`
    seeded: bool = False  # takes a seed from which every random number follows
    by_default: bool = False  # runs when no benchmark is named

    def measure(self, seed: int | PerceptionOptions) -> dict[str, Any]:
        """Run the benchmark; return its tables: name -> row -> column -> value, or name -> value."""
        module, _, function = self.source.partition(":")
        call: Callable[..., dict[str, Any]] = getattr(importlib.import_module(f"{HERE}.{module}"), function)
        return call(seed) if self.seeded else call()


def _seeded(source: str, summary: str) -> Benchmark:
    return Benchmark(source, summary, seeded=True)


BENCHMARKS: dict[str, Benchmark] = {
    "estimators": Benchmark(
        "estimators:bench_estimators", "time of each estimator for one frame", by_default=True
    ),
    "renderer": Benchmark("renderer:bench_renderer", "time of a rendered frame", by_default=True),
    "lockstep": Benchmark("lockstep:bench_lockstep", "real-time factor of the closed loop", by_default=True),
    "plants": Benchmark(
        "plants:bench_plants", "steps per second of the vehicle models and their peers", by_default=True
    ),
    "sweep": Benchmark("sweep:bench_sweep", "speed-up of two processes over one", by_default=True),
    "determinism": Benchmark("sweep:bench_determinism", "one trace hash from 100 runs under load"),
    "drive": Benchmark("drive:bench_drive", "one lap live: tracking error, latency, load of each process"),
    "suite": _seeded("suite:bench_suite", "all scenarios in lock-step: passed, departures, tracking error"),
    "seeds": _seeded("seeds:bench_seeds", "scores with known seeds and with fresh ones"),
    PERCEPTION: _seeded(
        "perception.bench:bench_perception", "every estimator on rendered clips and on labelled real images"
    ),
    "control-lateral": _seeded(
        "control.lateral:bench_lateral", "tracking error of the lateral laws and two baselines"
    ),
    "control-mpc": _seeded("control.mpc:bench_mpc", "time of an MPC step, relative to acados"),
    "control-speeds": _seeded(
        "control.speeds:bench_speeds", "tracking error from 5 mph to 30 m/s with one tuning"
    ),
    "control-deep-steer": _seeded(
        "control.deep_steer:bench_deep_steer", "the failure of Deep Steer above 5 mph, reproduced"
    ),
    "control-drift": _seeded("control.drift:bench_drift", "overshoot after a drift, as in Euro NCAP LSS"),
    "control-learning": _seeded(
        "control.learning:bench_learning", "error with and without learned steering offset and understeer"
    ),
    "control-longitudinal": _seeded(
        "control.longitudinal:bench_longitudinal", "stopping distance and following of a braking vehicle"
    ),
    "control-ranking": _seeded("control.speeds:bench_ranking", "rank correlation of the laws between plants"),
    "control-limits": _seeded(
        "control.limits:bench_limits", "random drives to the limits of ISO 11270 and R79"
    ),
    "control-random": _seeded("control.lateral:bench_random", "1000 cars that differ from their file"),
    "fear-inference": _seeded(
        "fear.inference:bench_inference", "time of an inference, relative to scikit-fuzzy"
    ),
    "fear-causes": _seeded("fear.causes:bench_causes", "share of injected faults whose cause is named right"),
    "fear-fuzz": _seeded("fear.fuzz:bench_fuzz", "broken numbers in messages never lower fear"),
    "fear-supervision": _seeded(
        "fear.supervision:bench_supervision", "supervised car and unsupervised drivers on hard drives"
    ),
    "follow-detector": _seeded("follow.detector:bench_lead", "recall and precision of the lead detector"),
    "follow-runs": _seeded("follow.runs:bench_runs", "1000 cases of following with a modelled detector"),
    "follow-rendered": _seeded("follow.runs:bench_rendered", "40 cases of following with rendered images"),
}
LONG = {"control-limits", "control-random"}
"""Benchmarks of half an hour, which their group leaves out."""
GROUPS = ("control", "fear", "follow")


def named(name: str) -> list[str]:
    """Benchmarks that ``name`` stands for: itself, or the members of a group such as ``control`` without LONG."""
    if name in GROUPS:
        return [known for known in BENCHMARKS if known.startswith(f"{name}-") and known not in LONG]
    return [name]
