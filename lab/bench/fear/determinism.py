"""Determinism of the rules: ``python -m lab.bench.fear.determinism SEED`` prints a hash."""

import hashlib
import json
import os
import random
import struct
import subprocess
import sys

from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import Point
from trepid.config import CONFIG_DIR, ROOT


def random_point(rules: FearRules, rng: random.Random, share: float = 1.0) -> Point:
    """Every input uniform over ``share`` of its range from the calm end."""
    return {
        name: spec.calmest + share * rng.random() * (spec.worst - spec.calmest)
        for name, spec in rules.inputs.items()
    }


def differing_processes(seed: int, *, processes: int = 3) -> int:
    """Number of processes, each with another hash seed, whose results differ from those of this process."""
    command = [sys.executable, "-m", "lab.bench.fear.determinism", str(seed)]
    own = result_hash(seed)
    differ = 0
    for n in range(processes):
        env = {**os.environ, "PYTHONHASHSEED": str(n)}
        done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, check=True, text=True)
        differ += done.stdout.strip() != own
    return differ


def result_hash(seed: int, *, count: int = 2000) -> str:
    """Hash of all results of the shipped rules at ``count`` points drawn by ``seed``."""
    rules, rng, digest = FearRules.load(CONFIG_DIR / "fear.yaml"), random.Random(seed), hashlib.sha256()
    for _ in range(count):
        rated = rules.evaluate(random_point(rules, rng, rng.random()))
        digest.update(struct.pack(f"<{1 + len(rated.strengths)}d", rated.fear, *rated.strengths))
        digest.update(json.dumps([rated.cause, rated.texts]).encode())
    return digest.hexdigest()


if __name__ == "__main__":
    print(result_hash(int(sys.argv[1])))
