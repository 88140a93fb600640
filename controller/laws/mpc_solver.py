"""Real-time iteration for `controller.laws.mpc`: linearise about the last plan, condense, solve one QP, check it.

    min ½·|r + R·Δw|² + ½·h·ρ²·|w + Δw - w_aim|² + h·Σ_k (½·q·ε_k² + l·ε_k)    over Δw and ε ≥ 0
    rate_low ≤ w + Δw ≤ rate_high      |c_k| ≤ max(most_command, |c_0| - k·h·rate)      |e_k| ≤ most_offset + ε_k

The limits of w and c are hard, and there always is a w within them: c_0 is where it is, and where it is too large
the limit comes down from there no faster than w may. The lane is soft. So every QP has a solution, and a solver
that finds no solution has failed.

States are eliminated (single shooting): the problem is linearised about the roll-out of the plan, so there are no
defects, and the QP has N unknowns. Its solver starts from the last active constraints. DAQP can
report success with a solution of NaN and keep it in its memory: the solution is checked, and after a failure
solver and plan are discarded.

Diehl, Bock, Schlöder, A real-time iteration scheme for nonlinear optimization in optimal feedback control (2005);
Arnström, Bemporad, Axehill, A dual active-set solver for embedded quadratic programming (2022).
"""

import math
import struct
from typing import NamedTuple

import daqp
import numpy as np

from controller.laws.mpc_model import HEAD, Grid, Problem, first_plan, quadratic
from trepid.types import Array

_SOFT = 8  # DAQP's mark of a soft constraint
_SOLVED = (1, 2)  # DAQP: solved; solved with soft constraints violated
_STEEPEST_RAD = 1.2  # roll-outs beyond it are no guess: tan ψ and 1/cos ψ take over
_COLD_ITERATIONS = 3
_MOST_STEPS = 200  # of the active-set method, some 2 µs each; a few are the rule, at many limits 20


class Soft(NamedTuple):
    """Price of a metre beyond the soft bound of e."""

    linear: float  # l
    quadratic: float  # q


class Solver:
    """Keeps the plan w from one problem to the next."""

    def __init__(self, grid: Grid, soft: Soft) -> None:
        stages = grid.stages
        self.plan: Array | None = None  # None: starts from the first plan
        self.states = np.zeros((stages, 4))  # (e, p, a, c) that the last QP was about
        self._grid, self._soft = grid, soft
        self._packed = np.zeros(2 + HEAD + stages)
        self._pack_head = struct.Struct(f"{2 + HEAD}d").pack_into
        self._about, self._steepest = np.zeros(stages), np.zeros(1)
        self._slopes = np.zeros((3 * stages, stages))  # R
        self._twin = np.zeros_like(self._slopes)  # R again
        self._hessian = np.zeros((stages, stages))
        self._gradient = np.zeros(stages)  # g
        self._rows = np.zeros((2 * stages - 1, stages))  # A
        self._high, self._low = np.zeros(3 * stages - 1), np.zeros(3 * stages - 1)
        self._buffer, self._linearise = quadratic(grid).buffer()
        self._buffer.set_arg(0, self._packed.data)
        plan, cost = (self._about, self.states, self._steepest), (self._slopes, self._gradient)
        for i, output in enumerate((*plan, *cost, self._rows, self._high, self._low)):
            self._buffer.set_res(i, output.data)
        self._first_plan = first_plan(grid)
        self._ones = np.ones(stages)
        self._regular = grid.h * grid.weights()[3] * np.eye(stages)
        self._qp: daqp.Model | None = None

    def reset(self) -> None:
        """Discard the plan and the state of the QP solver."""
        self.plan, self._qp = None, None

    def solve(self, now: Problem, *, shift: float = 0.0, scale: float = 1.0) -> Array | None:
        """The plan w (N,) for ``now``; None, with all state discarded, without a valid one.

        The last plan is moved on by ``shift`` of a stage, at most one, and multiplied by ``scale`` first.
        """
        plan = self._iterate(now, shift, scale)
        if plan is None:
            self.reset()
        self.plan = plan
        return plan

    def _iterate(self, now: Problem, shift: float, scale: float) -> Array | None:
        """One iteration from the last plan; several from the first plan where the last one is not usable."""
        if self.plan is not None and self._about_plan(self.plan, now, shift, scale):
            return self._improve()
        plan: Array | None = np.asarray(self._first_plan(now)).ravel()
        for _ in range(_COLD_ITERATIONS):
            if plan is None or not self._about_plan(plan, now):
                return None
            plan = self._improve()
        return plan

    def _about_plan(self, plan: Array, now: Problem, shift: float = 0.0, scale: float = 1.0) -> bool:
        """Linearise about ``plan``; whether its headings stay within the limits of the model."""
        self._pack_head(self._packed.data, 0, shift, scale, *now)
        self._packed[2 + HEAD :] = plan
        self._linearise()
        # Written so that NaN is refused, too.
        return self._steepest.item() <= now.length_m * _STEEPEST_RAD

    def _improve(self) -> Array | None:
        """The plan plus Δw; None unless the QP is solved and finite."""
        # Two arrays make BLAS use its general product, which is faster; np.dot has less overhead than @.
        np.copyto(self._twin, self._slopes)
        hessian = np.dot(self._slopes.T, self._twin, out=self._hessian)
        hessian += self._regular
        step, _, status, _ = self._solve_qp(hessian, self._gradient)
        if status not in _SOLVED or not math.isfinite(step.dot(self._ones)):
            return None
        return self._about + step

    def _solve_qp(self, hessian: Array, gradient: Array) -> tuple[Array, float, int, dict]:
        """Result of DAQP, started from the last active constraints."""
        if self._qp is None:
            sense = np.zeros(len(self._high), dtype=np.int32)
            sense[2 * self._grid.stages :] = _SOFT
            self._qp = daqp.Model()
            self._qp.settings = {"iter_limit": _MOST_STEPS}
            self._qp.setup(hessian, gradient, self._rows, self._high, self._low, sense)
            self._price(self._qp)
        else:
            self._qp.update(hessian, gradient, self._rows, self._high, self._low)
        return self._qp.solve()

    def _price(self, qp: daqp.Model) -> None:
        reciprocal = np.full(len(self._high), 1.0 / (self._soft.quadratic * self._grid.h))
        linear = np.full(len(self._high), self._soft.linear * self._grid.h)
        qp.soft_weights(rho_l=reciprocal, rho_u=reciprocal, w_l=linear, w_u=linear)
