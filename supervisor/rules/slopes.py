"""The greatest rate of change of fear: a Lipschitz bound for every input, from the edges of the sets.

With fear = sum_k (a_k - a_{k-1}) t_k, and t_k a max of mins of weighted ramps, no t_k changes faster with an input
than the steepest ramp, times weight, that a rule for level k or more has on the piece of the range that contains
the input; so

    |dfear/dx_i| <= max over pieces of sum_k (a_k - a_{k-1}) * max over ramps w / |span|.

Only for the method ``monotone``.
"""

import itertools

from supervisor.rules.inference import FearRules
from supervisor.rules.monotone import Ramp, cases


def lipschitz(rules: FearRules) -> dict[str, float]:
    """Greatest change of fear per unit of every input."""
    ramps: list[list[tuple[int, float, Ramp]]] = [[] for _ in rules.names]  # harm, weight, ramp
    for rule in rules.fear_voice.rules:
        for case in cases(rule, rules.inputs) if rule.harm else ():
            for ramp in case:
                ramps[ramp.input].append((rule.harm, rule.weight, ramp))
    places = [action.at for action in rules.file.fear.all]
    steps = [b - a for a, b in itertools.pairwise(places)]
    return {name: _steepest(own, steps) for name, own in zip(rules.names, ramps, strict=True)}


def _steepest(ramps: list[tuple[int, float, Ramp]], steps: list[float]) -> float:
    corners = sorted({x for _, _, ramp in ramps for piece in ramp.pieces() for x in piece[:2]})
    middles = [(a + b) / 2 for a, b in itertools.pairwise(corners)]
    return max((_slope(ramps, steps, x) for x in middles), default=0.0)


def _slope(ramps: list[tuple[int, float, Ramp]], steps: list[float], x: float) -> float:
    here = [
        (harm, weight * slope)
        for harm, weight, ramp in ramps
        for low, high, slope in ramp.pieces()
        if min(low, high) < x < max(low, high)
    ]
    return sum(
        step * max((slope for harm, slope in here if harm >= level), default=0.0)
        for level, step in enumerate(steps, start=1)
    )
