"""Populations as samplers of Optuna: Bats and their harmony variant, particle swarm, differential evolution, GA.

Positions are in the unit cube: a number relative to its range (that of a logarithmic one by its logarithm).
A sampler keeps no state: members, velocities and draws are attributes of the trials, so that several processes can
share a study and an interrupted one continues. The first trials, one a member, are uniform. All minimise.

Yang, A New Metaheuristic Bat-Inspired Algorithm (2010). Geem, Kim and Loganathan, A New Heuristic Optimization
Algorithm: Harmony Search (2001). Clerc and Kennedy, The Particle Swarm (2002). Storn and Price, Differential
Evolution (1997). Eshelman and Schaffer, Real-Coded Genetic Algorithms and Interval-Schemata (1993).
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from optuna import Study
from optuna.distributions import BaseDistribution, FloatDistribution
from optuna.samplers import BaseSampler, RandomSampler
from optuna.search_space import IntersectionSearchSpace
from optuna.trial import FrozenTrial, TrialState

Point = NDArray[np.float64]
MEMBER, VELOCITY, DRAW = (
    "population:member",
    "population:velocity",
    "population:draw",
)  # attributes of a trial
INERTIA, PULL = 0.7298, 1.49618  # constriction of Clerc and Kennedy
FREQUENCIES = (0.0, 2.0)
LOUDNESS, LOUDNESS_RATIO, PULSE, PULSE_RATE, WALK = 1.0, 0.9, 0.5, 0.9, 0.1
MEMORY, PITCH, BANDWIDTH = 0.9, 0.3, 0.05  # of harmony search
FACTOR, CROSSOVER = 0.5, 0.9  # F and CR of DE/rand/1/bin
BLEND, MUTATION, MUTATION_SIGMA = 0.5, 0.1, 0.1


def bat_velocity(velocity: Point, x: Point, best: Point, beta: float) -> Point:
    """v + (x - x*)·f with f = f_min + (f_max - f_min)·β; the bat then flies to x + v (Yang, eq. 2 to 4)."""
    low, high = FREQUENCIES
    return velocity + (x - best) * (low + (high - low) * beta)


def pulse_rate(accepted: int) -> float:
    """r = r0·(1 - exp(-γ·t)) after t accepted steps (Yang, eq. 6)."""
    return PULSE * (1.0 - math.exp(-PULSE_RATE * accepted))


def loudness(accepted: int) -> float:
    """A = A0·α^t after t accepted steps (Yang, eq. 6)."""
    return LOUDNESS * LOUDNESS_RATIO**accepted


def swarm_velocity(velocity: Point, x: Point, own: Point, best: Point, first: Point, second: Point) -> Point:
    """w·v + c·r1·(p - x) + c·r2·(g - x), with random r1 and r2 in the unit cube."""
    return INERTIA * velocity + PULL * first * (own - x) + PULL * second * (best - x)


def differential_trial(x: Point, a: Point, b: Point, c: Point, crosses: NDArray[np.bool_]) -> Point:
    """a + F·(b - c) where it crosses, else x: DE/rand/1/bin."""
    return np.where(crosses, a + FACTOR * (b - c), x)


def blend(mother: Point, father: Point, share: Point) -> Point:
    """BLX-α: a point of the box of both parents, wider by α of their distance at each side; ``share`` in 0 to 1."""
    low, size = np.minimum(mother, father), np.abs(mother - father)
    return low - BLEND * size + share * (1.0 + 2.0 * BLEND) * size


def improvise(memory: Sequence[Point], rng: np.random.Generator) -> Point:
    """A harmony: each number from the memory, at times out of tune by a bandwidth, else at random."""
    size = len(memory[0])
    known = np.array([memory[int(rng.integers(len(memory)))][j] for j in range(size)])
    tuned = known + np.where(rng.random(size) < PITCH, BANDWIDTH * rng.uniform(-1.0, 1.0, size), 0.0)
    return np.where(rng.random(size) < MEMORY, tuned, rng.random(size))


@dataclass(slots=True)
class Individual:
    """What the trials of a member add up to."""

    x: Point  # of the bat: the accepted one; else the newest
    velocity: Point
    best: Point
    cost: float
    accepted: int = 0


@dataclass(slots=True)
class Proposal:
    """The next point of a member, and what its trial keeps."""

    x: Point
    velocity: Point


class PopulationSampler(BaseSampler):
    """A population: the members take turns. A subclass states the step of one. Not for several objectives."""

    keeps_best = False  # a step that is no better is not taken

    def __init__(self, *, members: int = 12, seed: int | None = None) -> None:
        self._members = members
        self._rng = np.random.default_rng(seed)
        self._independent = RandomSampler(seed=seed)

    def step(self, member: Individual, others: Sequence[Individual], best: Individual) -> Proposal:
        """The next step of ``member``; ``others`` are the other members, ``best`` the best of all."""
        raise NotImplementedError

    def reseed_rng(self) -> None:
        self._rng = np.random.default_rng()
        self._independent.reseed_rng()

    def infer_relative_search_space(self, study: Study, trial: FrozenTrial) -> dict[str, BaseDistribution]:
        space = IntersectionSearchSpace().calculate(study)
        return {
            name: one
            for name, one in space.items()
            if isinstance(one, FloatDistribution) and not one.single()
        }

    def sample_independent(
        self, study: Study, trial: FrozenTrial, param_name: str, param_distribution: BaseDistribution
    ) -> Any:
        return self._independent.sample_independent(study, trial, param_name, param_distribution)

    def sample_relative(
        self, study: Study, trial: FrozenTrial, search_space: dict[str, BaseDistribution]
    ) -> dict[str, Any]:
        if not search_space:
            return {}
        trials = [one for one in study.get_trials(deepcopy=False) if one.number != trial.number]
        number = sum(MEMBER in one.system_attrs for one in trials) % self._members
        found = self._propose(self._herd(trials, search_space), number, len(search_space))
        kept = {MEMBER: number, VELOCITY: found.velocity.tolist(), DRAW: float(self._rng.random())}
        for name, value in kept.items():
            study._storage.set_trial_system_attr(trial._trial_id, name, value)
        return {name: _value(one, x) for (name, one), x in zip(search_space.items(), found.x, strict=True)}

    def minimise(
        self, cost: Callable[[Point], float], dimensions: int, evaluations: int
    ) -> tuple[Point, float]:
        """The best point of the unit cube and its cost after some evaluations, without a study: members in turn."""
        herd: dict[int, Individual] = {}
        for evaluation in range(evaluations):
            number = evaluation % self._members
            found = self._propose(herd, number, dimensions)
            self._take(herd, number, found, cost(found.x), float(self._rng.random()))
        best = min(herd.values(), key=lambda one: one.cost)
        return best.best, best.cost

    def _propose(self, herd: Mapping[int, Individual], number: int, dimensions: int) -> Proposal:
        """The next point of a member, within the unit cube."""
        if number in herd and len(herd) > 3:
            others = [member for name, member in herd.items() if name != number]
            found = self.step(herd[number], others, min(herd.values(), key=lambda one: one.cost))
        else:
            found = Proposal(self._rng.random(dimensions), np.zeros(dimensions))
        found.x = np.clip(found.x, 0.0, 1.0)
        return found

    def _herd(
        self, trials: Sequence[FrozenTrial], space: Mapping[str, BaseDistribution]
    ) -> dict[int, Individual]:
        """The members by their finished trials, in order."""
        herd: dict[int, Individual] = {}
        for one in trials:
            if one.state != TrialState.COMPLETE or MEMBER not in one.system_attrs or one.value is None:
                continue
            x = np.array([_share(space[name], one.params[name]) for name in space])
            velocity, number = np.array(one.system_attrs[VELOCITY]), int(one.system_attrs[MEMBER])
            self._take(herd, number, Proposal(x, velocity), one.value, one.system_attrs[DRAW])
        return herd

    def _take(
        self, herd: dict[int, Individual], number: int, found: Proposal, cost: float, draw: float
    ) -> None:
        """Let a member have been at a point of a known cost."""
        if number not in herd:
            herd[number] = Individual(found.x, found.velocity, found.x, cost)
            return
        member = herd[number]
        better = cost <= member.cost
        if not self.keeps_best:
            member.x = found.x
        elif better and draw < self.acceptance(member):
            member.x, member.accepted = found.x, member.accepted + 1
        member.velocity = found.velocity
        if better:
            member.best, member.cost = found.x, cost

    def acceptance(self, member: Individual) -> float:
        """The probability that a better step is taken where only better ones are."""
        return 1.0


class BatSampler(PopulationSampler):
    """The Bat algorithm: a flight, or with probability 1 - r a walk around the best, of the mean loudness."""

    keeps_best = True

    def acceptance(self, member: Individual) -> float:
        return loudness(member.accepted)

    def step(self, member: Individual, others: Sequence[Individual], best: Individual) -> Proposal:
        velocity = bat_velocity(member.velocity, member.x, best.best, float(self._rng.random()))
        if self._rng.random() > pulse_rate(member.accepted):
            return Proposal(self.search_near([member, *others], best), velocity)
        return Proposal(member.x + velocity, velocity)

    def search_near(self, herd: Sequence[Individual], best: Individual) -> Point:
        """x* + ε·A with ε uniform in ±WALK and A the mean loudness (Yang, eq. 5)."""
        mean = float(np.mean([loudness(one.accepted) for one in herd]))
        return best.best + WALK * mean * self._rng.uniform(-1.0, 1.0, len(best.best))


class HarmonyBatSampler(BatSampler):
    """The harmony variant: a harmony of the best points of all bats instead of the walk."""

    def search_near(self, herd: Sequence[Individual], best: Individual) -> Point:
        return improvise([one.best for one in herd], self._rng)


class SwarmSampler(PopulationSampler):
    """Particle swarm with a global best."""

    def step(self, member: Individual, others: Sequence[Individual], best: Individual) -> Proposal:
        first, second = self._rng.random((2, len(member.x)))
        velocity = swarm_velocity(member.velocity, member.x, member.best, best.best, first, second)
        return Proposal(member.x + velocity, velocity)


class DifferentialSampler(PopulationSampler):
    """Differential evolution, DE/rand/1/bin: at least one number crosses."""

    def step(self, member: Individual, others: Sequence[Individual], best: Individual) -> Proposal:
        a, b, c = (others[i].best for i in self._rng.choice(len(others), 3, replace=False))
        crosses = self._rng.random(len(member.x)) < CROSSOVER
        crosses[self._rng.integers(len(crosses))] = True
        return Proposal(differential_trial(member.best, a, b, c, crosses), np.zeros_like(a))


class GeneticSampler(PopulationSampler):
    """A genetic algorithm: parents by tournaments of two, BLX-α, and normal mutation of some numbers."""

    def step(self, member: Individual, others: Sequence[Individual], best: Individual) -> Proposal:
        herd = [member, *others]
        mother, father = (
            min(
                (herd[i] for i in self._rng.choice(len(herd), 2, replace=False)), key=lambda one: one.cost
            ).best
            for _ in range(2)
        )
        size = len(mother)
        child = blend(mother, father, self._rng.random(size))
        noise = MUTATION_SIGMA * self._rng.standard_normal(size)
        return Proposal(child + np.where(self._rng.random(size) < MUTATION, noise, 0.0), np.zeros(size))


def _share(one: BaseDistribution, value: float) -> float:
    """Where ``value`` stands within the range of a number, 0 to 1."""
    assert isinstance(one, FloatDistribution)
    scale = math.log if one.log else float
    return (scale(value) - scale(one.low)) / (scale(one.high) - scale(one.low))


def _value(one: BaseDistribution, share: float) -> float:
    """The inverse of :func:`_share`, at a step of the range."""
    assert isinstance(one, FloatDistribution)
    if one.log:
        return min(max(one.low * (one.high / one.low) ** share, one.low), one.high)
    value = one.low + share * (one.high - one.low)
    return value if one.step is None else one.low + one.step * round((value - one.low) / one.step)
