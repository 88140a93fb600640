"""The optimal control problem of :mod:`controller.laws.mpc` in casadi: dynamics of one stage, preview, condensing.

All quantities are scaled by the length ℓ over which the law brings the car back, so that they are similar at all
speeds: σ = s/ℓ along the lane, e offset [m], p = ℓ·ψ [m], a = ℓ²·κ_a [m], c = ℓ²·κ_c [m], w = ℓ³·dκ_c/ds [m].

    de/dσ = ℓ·(1 - κ·e)·tan ψ                            da/dσ = (c - a)/θ        θ = v·τ/ℓ
    dp/dσ = a·(1 - κ·e)/cos ψ - ℓ²·κ                dc/dσ = w

κ lane curvature, κ_a curvature of the rear axle's path, κ_c demanded curvature, τ lag of the steering. w is
constant over a stage of h. The two linear equations are solved exactly, with which e and p take one midpoint
step. (The lag counts σ along the lane; along the path it is (1 - κ·e)/cos ψ of it.)

Verschueren et al., Towards time-optimal race car driving using nonlinear MPC (2014), section II (the bicycle along
the lane); Frison and Jørgensen, A fast condensing method for solution of linear-quadratic control problems (2013).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np


class Grid(NamedTuple):
    """Structure of every problem: number and length of the stages."""

    stages: int  # N
    h: float  # length of a stage, in ℓ
    quickness: float  # ρ of the third pole, in ℓ: 1 for three alike

    def weights(self) -> tuple[float, float, float, float]:
        """Of e², p², a², w². Without horizon, limits and lag the best loop then is (ℓ·s + 1)²·(ρ·ℓ·s + 1) = 0.

        Spectral factorisation: with q = -(ℓ·s)² its product with its mirror image is (1 + q)²·(1 + ρ²·q).
        """
        squared = self.quickness**2
        return 1.0, 2.0 + squared, 1.0 + 2.0 * squared, squared

    def terminal(self) -> tuple[tuple[float, float, float], ...]:
        """Cost to go from (e, p, a): the solution of the Riccati equation, in closed form."""
        rho = self.quickness
        return (
            (2.0 + rho, 1.0 + 2.0 * rho, rho),
            (1.0 + 2.0 * rho, 2.0 + 4.0 * rho + 2.0 * rho**2, rho * (2.0 + rho)),
            (rho, rho * (2.0 + rho), rho * (1.0 + 2.0 * rho)),
        )


class Problem(NamedTuple):
    """Numbers of one problem except the initial plan, in the order of the packed argument."""

    offset_m: float
    scaled_heading_m: float  # p
    scaled_curvature_m: float  # a
    scaled_command_m: float  # c
    length_m: float  # ℓ
    lag: float  # θ
    curvature_1pm: float  # of the lane at the axle, ...
    curvature_rate_1pm2: float  # ... its rate, ...
    lookahead_m: float  # ... and the distance to which it is known
    excess_m: float  # offset beyond that from which the car returns directly
    approach: float  # tangent of the approach angle from there
    rate_low: float  # of w, below ...
    rate_high: float  # ... this
    most_command_m: float  # of |c|
    most_offset_m: float  # of |e|, soft


HEAD = len(Problem._fields)
TINY = 1e-300  # a maximum alone passes over NaN; with this share of the sum it does not


def stage(h: float) -> ca.Function:
    """(x, w, κ₀, κ₁, ℓ, θ) -> x of the next stage, x = (e, p, a, c)."""
    x, w = ca.SX.sym("x", 4), ca.SX.sym("w")
    bend0, bend1 = ca.SX.sym("bend0"), ca.SX.sym("bend1")
    length, lag = ca.SX.sym("length"), ca.SX.sym("lag")
    e, p, a, c = ca.vertsplit(x)

    def turning(sigma: float) -> ca.SX:
        """a at ``sigma`` into the stage, the lag's answer to a ramp."""
        return c + w * (sigma - lag) + (a - c + lag * w) * ca.exp(-sigma / lag)

    def rates(e: ca.SX, p: ca.SX, a: ca.SX, bend: ca.SX) -> ca.SX:
        psi, share = p / length, 1 - bend * e
        turn = a * share / ca.cos(psi) - length**2 * bend
        return ca.vertcat(length * share * ca.tan(psi), turn)

    halfway = ca.vertcat(e, p) + h / 2 * rates(e, p, a, bend0)
    pose = ca.vertcat(e, p) + h * rates(halfway[0], halfway[1], turning(h / 2), (bend0 + bend1) / 2)
    after = ca.vertcat(pose, turning(h), c + h * w)
    return ca.Function("stage", [x, w, bend0, bend1, length, lag], [after])


def preview(grid: Grid) -> ca.Function:
    """Problem -> lane curvature κ (1, N + 1), and references: (e, p, a) (3, N + 1) and w (1, N).

    The references are the curvature of the lane and the rate of the command that reaches it through the lag. For a
    car far from the lane they are a straight line back to it, at the angle whose tangent is ``approach``.
    """
    stages, h = grid.stages, grid.h
    head = ca.SX.sym("head", HEAD)
    now = Problem._make(ca.vertsplit(head))
    ahead_m = now.length_m * h * ca.DM(np.arange(stages + 1.0)).T

    def bend(ahead_m: ca.SX) -> ca.SX:
        return now.curvature_1pm + now.curvature_rate_1pm2 * ca.fmin(ahead_m, now.lookahead_m)

    left_m = ca.fmax(ca.fabs(now.excess_m) - now.approach * ahead_m, 0)
    offset = ca.sign(now.excess_m) * left_m
    heading = -now.length_m * ca.atan(now.approach) * ca.sign(offset)
    lag_m = now.lag * now.length_m
    demand = now.length_m**2 * bend(ahead_m + lag_m)
    aims = ca.vertcat(offset, heading, now.length_m**2 * bend(ahead_m))
    return ca.Function("preview", [head], [bend(ahead_m), aims, ca.diff(demand, 1, 1) / h])


@lru_cache(maxsize=8)
def quadratic(grid: Grid) -> ca.Function:
    """(shift, scale, Problem, last plan w (N,)) packed -> the QP for Δw about that plan, shifted and scaled.

    - the plan w (N,), its states x (N, 4) at the ends of the stages, and the largest |p| of them,
      NaN where one of them is,
    - R (3·N, N) and g (N,): the cost is ½·|R·Δw|² + ½·h·ρ²·|Δw|² + Δw·g, but for a constant,
    - A (2·N - 1, N): effect of Δw on c at the end of every stage, and on e at that of every stage but the last,
    - the highest and lowest Δw and A·Δw (3·N - 1,) each.

    Matrices come transposed, so that in memory they are row by row.
    """
    stages, h = grid.stages, grid.h
    packed = ca.SX.sym("packed", 2 + HEAD + stages)
    head, last = packed[2 : 2 + HEAD], packed[2 + HEAD :]
    now, linear = Problem._make(ca.vertsplit(head)), _linear_stage(h)
    bends, aims, rates = preview(grid)(head)
    w = packed[1] * (last + packed[0] * ca.vertcat(ca.diff(last), 0))
    x, slope = head[:4], ca.SX(4, stages)  # sparse: only nonzero entries are computed
    track, slopes = [], []
    for k in range(stages):
        x, by_x, by_w = linear(x, w[k], bends[k], bends[k + 1], now.length_m, now.lag)
        slope = by_x @ slope
        slope[:, k] += by_w
        track.append(x)
        slopes.append(slope)
    *weights, regular = grid.weights()
    roots = [math.sqrt(h) * np.diag(np.sqrt(weights))] * (stages - 1) + [
        np.linalg.cholesky(grid.terminal()).T
    ]
    errors = [root @ (x[:3] - aims[:, k + 1]) for k, (root, x) in enumerate(zip(roots, track, strict=True))]
    cost_rows = [root @ slope[:3, :] for root, slope in zip(roots, slopes, strict=True)]
    rows = ca.vertcat(*(slope[3, :] for slope in slopes), *(slope[0, :] for slope in slopes[:-1]))
    states = ca.horzcat(*track)
    command = command_bounds(grid)(head)
    high = ca.vertcat(now.rate_high - w, command - states[3, :].T, now.most_offset_m - states[0, :-1].T)
    low = ca.vertcat(now.rate_low - w, -command - states[3, :].T, -now.most_offset_m - states[0, :-1].T)
    headings = states[1, :]
    largest = ca.mmax(ca.fabs(headings)) + TINY * ca.sum2(headings)
    cost_slope = ca.vertcat(*cost_rows)
    gradient = cost_slope.T @ ca.vertcat(*errors) + h * regular * (w - rates.T)
    cost = [ca.densify(cost_slope.T), gradient]
    return ca.Function(
        "quadratic", [packed], [w, states, largest, *cost, ca.densify(rows.T), high, low], {"cse": True}
    )


def command_bounds(grid: Grid) -> ca.Function:
    """Problem -> limit (N,) of |c| at the end of every stage.

    Where c is too large now, the limit comes down from there no faster than c can: some w is always allowed.
    """
    stages, h = grid.stages, grid.h
    head = ca.SX.sym("head", HEAD)
    now = Problem._make(ca.vertsplit(head))
    down = ca.if_else(now.scaled_command_m > 0, -now.rate_low, now.rate_high)
    left = ca.fabs(now.scaled_command_m) - down * h * ca.DM(np.arange(1.0, stages + 1.0))
    return ca.Function("command_bounds", [head], [ca.fmax(left, now.most_command_m)])


def _linear_stage(h: float) -> ca.Function:
    """:func:`stage` with its derivatives by x and by w."""
    step = stage(h)
    inputs = [ca.SX.sym(f"i{i}", *step.size_in(i)) for i in range(step.n_in())]
    after = step(*inputs)
    by_x, by_w = ca.jacobian(after, inputs[0]), ca.jacobian(after, inputs[1])
    return ca.Function("linear_stage", inputs, [after, by_x, by_w])


@lru_cache(maxsize=8)
def first_plan(grid: Grid) -> ca.Function:
    """Problem -> w (N,) of the feedback w = w_aim - e - 3·p - 3·c, less their aims, within the limits of w.

    A triple pole without the lag, stable up to a lag of 1.6: an initial guess.
    """
    head = ca.SX.sym("head", HEAD)
    now, step = Problem._make(ca.vertsplit(head)), stage(grid.h)
    bends, aims, rates = preview(grid)(head)
    x, plan = head[:4], []
    for k in range(grid.stages):
        offset, heading, command = x[0] - aims[0, k], x[1] - aims[1, k], x[3] - aims[2, k]
        wanted = rates[k] - offset - 3 * heading - 3 * command
        w = ca.fmin(ca.fmax(wanted, now.rate_low), now.rate_high)
        x = step(x, w, bends[k], bends[k + 1], now.length_m, now.lag)
        plan.append(w)
    return ca.Function("first_plan", [head], [ca.vertcat(*plan)])
