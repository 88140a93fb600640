"""The classical Runge-Kutta step of order 4, for inputs that are known in closed form.

Hairer, Nørsett and Wanner, Solving Ordinary Differential Equations I (1993), section II.1.
"""

from collections.abc import Callable, Sequence
from typing import TypeVar

Inputs = TypeVar("Inputs")
State = tuple[float, ...]


def rk4(
    rates: Callable[[State, Inputs], Sequence[float]],
    state: State,
    start: Inputs,
    middle: Inputs,
    end: Inputs,
    h: float,
) -> State:
    """``state`` after ``h`` under state' = rates(state, inputs), with the inputs at start, middle and end."""
    k1 = rates(state, start)
    k2 = rates(_add_rates(state, k1, h / 2), middle)
    k3 = rates(_add_rates(state, k2, h / 2), middle)
    k4 = rates(_add_rates(state, k3, h), end)
    return tuple(
        [x + h / 6 * (a + 2 * (b + c) + d) for x, a, b, c, d in zip(state, k1, k2, k3, k4, strict=True)]
    )


def _add_rates(state: State, rates: Sequence[float], h: float) -> State:
    return tuple([x + h * rate for x, rate in zip(state, rates, strict=True)])
