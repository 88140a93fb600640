"""MPC: the same optimum as IPOPT, limits kept, and never without an answer."""

import math
import subprocess
import sys
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE
from scipy.linalg import solve_continuous_are

from controller.laws.lateral import LawName, build_law
from controller.laws.law import Acting
from controller.laws.mpc import Mpc
from controller.laws.mpc_model import Grid, Problem, command_bounds, preview, stage
from controller.laws.mpc_solver import Soft, Solver
from trepid.clothoid import Lane

GRID = Grid(stages=20, h=0.25, quickness=0.3)
SOFT = Soft(linear=1.0, quadratic=10.0)
CALM = Problem(
    offset_m=0.3,
    scaled_heading_m=0.1,
    scaled_curvature_m=0.02,
    scaled_command_m=0.02,
    length_m=5.0,
    lag=0.2,
    curvature_1pm=0.01,
    curvature_rate_1pm2=0.001,
    lookahead_m=30.0,
    excess_m=0.0,
    approach=0.2,
    rate_low=-0.6,
    rate_high=0.6,
    most_command_m=0.75,
    most_offset_m=0.5,
)
MPC = SETTINGS.lateral.model_copy(update=dict(law=LawName.MPC))
LQI = SETTINGS.lateral.model_copy(update=dict(law=LawName.LQI))
DT_S = 0.02


def feedback(grid):
    """Gains of w = -(e, p, a)·gains, the best without limits and lag: (ℓ·s + 1)²·(ρ·ℓ·s + 1) = 0."""
    rho = grid.quickness
    return 1.0 / rho, (2.0 + rho) / rho, (1.0 + 2.0 * rho) / rho


def problems(count, seed=0):
    """Cars near their lane, from crawling to fast, most of them at some limit."""
    draw = np.random.default_rng(seed).uniform
    for _ in range(count):
        length_m, side = draw(2.0, 10.0), draw(-1.0, 1.0)
        yield Problem(
            offset_m=draw(-0.8, 0.8),
            scaled_heading_m=length_m * draw(-0.15, 0.15),
            scaled_curvature_m=0.3 * side,
            scaled_command_m=0.3 * side + draw(-0.2, 0.2),
            length_m=length_m,
            lag=draw(0.01, 1.0),
            curvature_1pm=draw(-0.3, 0.3) / length_m**2,
            curvature_rate_1pm2=draw(-0.2, 0.2) / length_m**3,
            lookahead_m=draw(0.0, 8.0) * length_m,
            excess_m=0.0,
            approach=0.2,
            rate_low=-draw(0.2, 2.0),
            rate_high=draw(0.2, 2.0),
            most_command_m=draw(0.4, 1.0),
            most_offset_m=draw(0.2, 0.8),
        )


@lru_cache
def ipopt():
    """The same problem, stated with all its states and slacks, for an interior-point method."""
    n, h = GRID.stages, GRID.h
    head = ca.SX.sym("head", len(Problem._fields))
    now, step = Problem._make(ca.vertsplit(head)), stage(h)
    bends, aims, rates = preview(GRID)(head)
    states, w, slack = ca.SX.sym("states", 4, n), ca.SX.sym("w", n), ca.SX.sym("slack", n - 1)
    before = ca.horzcat(head[:4], states[:, :-1])
    gaps = [
        step(before[:, k], w[k], bends[k], bends[k + 1], now.length_m, now.lag) - states[:, k]
        for k in range(n)
    ]
    error = states[:3, :] - aims[:, 1:]
    *weights, regular = GRID.weights()
    cost = 0.5 * h * regular * ca.sumsqr(w - rates.T)
    cost += 0.5 * h * ca.sum1(ca.DM(weights) * ca.sum2(error[:, :-1] ** 2))
    cost += 0.5 * error[:, -1].T @ ca.DM(np.array(GRID.terminal())) @ error[:, -1]
    cost += h * (SOFT.linear * ca.sum1(slack) + 0.5 * SOFT.quadratic * ca.sumsqr(slack))
    command, offset = states[3, :].T, states[0, :-1].T
    most = command_bounds(GRID)(head)
    limits = [w - now.rate_high, now.rate_low - w, command - most, -command - most, -slack]
    limits += [offset - slack - now.most_offset_m, -offset - slack - now.most_offset_m]
    constraints = ca.vertcat(*gaps, *limits)
    lowest = np.full(constraints.shape[0], -np.inf)
    lowest[: 4 * n] = 0.0
    nlp = dict(x=ca.vertcat(w, ca.vec(states), slack), p=head, f=cost, g=constraints)
    solver = ca.nlpsol(
        "oracle", "ipopt", nlp, {"print_time": 0, "ipopt": dict(print_level=0, tol=1e-9, sb="yes")}
    )

    def solve(problem):
        found = solver(x0=0.0, p=np.array(problem), lbg=lowest, ubg=0.0)
        assert solver.stats()["success"]
        return np.array(found["x"]).ravel()[:n]

    return solve


def converge(problem):
    solver = Solver(GRID, SOFT)
    for _ in range(15):
        plan = solver.solve(problem)
    return plan


def test_repeated_iterations_reach_the_optimum_that_ipopt_finds():
    at_limits = 0
    for problem in problems(25):
        plan, best = converge(problem), ipopt()(problem)
        assert plan == pytest.approx(best, abs=2e-5)
        at_limits += plan.max() > problem.rate_high - 1e-6 or plan.min() < problem.rate_low + 1e-6
    assert at_limits >= 5


def test_one_iteration_after_a_tick_is_as_good_as_many():
    solver = Solver(GRID, SOFT)
    solver.solve(CALM)
    share = 0.2  # of a stage, as at 50 Hz
    for _ in range(30):
        plan = solver.solve(CALM, shift=0.0)
    after = stage(share * GRID.h)(CALM[:4], plan[0], 0.01, 0.01, CALM.length_m, CALM.lag)
    later = CALM._replace(
        **dict(zip(Problem._fields[:4], np.array(after).ravel().tolist(), strict=True)), curvature_1pm=0.01025
    )
    assert solver.solve(later, shift=share) == pytest.approx(converge(later), abs=2e-3)


def test_the_mirrored_problem_has_the_mirrored_plan():
    for problem in problems(20, seed=1):
        mirrored = problem._replace(
            **{name: -getattr(problem, name) for name in (*Problem._fields[:4], "curvature_1pm")},
            curvature_rate_1pm2=-problem.curvature_rate_1pm2,
            rate_low=-problem.rate_high,
            rate_high=-problem.rate_low,
        )
        assert converge(mirrored) == pytest.approx(-converge(problem), abs=1e-9)


def test_every_plan_keeps_rate_and_command_within_their_limits():
    for problem in problems(100, seed=2):
        plan = Solver(GRID, SOFT).solve(problem)
        command = problem.scaled_command_m + GRID.h * np.cumsum(plan)
        assert plan.max() <= problem.rate_high + 1e-6
        assert plan.min() >= problem.rate_low - 1e-6
        assert np.all(np.abs(command) <= np.array(command_bounds(GRID)(problem)).ravel() + 1e-6)


def test_a_command_beyond_its_limit_comes_back_as_fast_as_it_may():
    problem = CALM._replace(scaled_command_m=2.0, scaled_curvature_m=2.0)
    plan = Solver(GRID, SOFT).solve(problem)
    beyond = np.flatnonzero(problem.scaled_command_m + GRID.h * np.cumsum(plan) > problem.most_command_m)
    assert plan[beyond] == pytest.approx(problem.rate_low, abs=1e-6)


@pytest.mark.parametrize("quickness", [0.1, 0.3, 1.0])
def test_the_cost_to_go_solves_the_riccati_equation(quickness):
    grid = GRID._replace(quickness=quickness)
    *weights, price = grid.weights()
    integrators, into = np.eye(3, k=1), np.array([[0.0], [0.0], [1.0]])
    terminal = solve_continuous_are(integrators, into, np.diag(weights), [[price]])
    assert np.array(grid.terminal()) == pytest.approx(terminal)
    assert (into.T @ terminal / price)[0] == pytest.approx(feedback(grid))


def test_without_limits_and_lag_the_plan_is_that_of_the_demanded_poles():
    grid = Grid(stages=60, h=0.1, quickness=0.5)
    free = CALM._replace(
        offset_m=0.1,
        scaled_heading_m=0.0,
        scaled_curvature_m=0.0,
        scaled_command_m=0.0,
        curvature_1pm=0.0,
        curvature_rate_1pm2=0.0,
        lag=1e-3,
        rate_low=-9.0,
        rate_high=9.0,
        most_command_m=9.0,
        most_offset_m=9.0,
    )
    solver = Solver(grid, SOFT)
    for _ in range(3):
        solver.solve(free)
    loop = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-gain for gain in feedback(grid)]])
    values, vectors = np.linalg.eig(loop)
    assert sorted(values.real) == pytest.approx([-2.0, -1.0, -1.0], abs=1e-6)
    sigma = grid.h * np.arange(1, 61)
    start = np.linalg.solve(vectors, [0.1, 0.0, 0.0])
    expected = np.real(vectors[0] * start @ np.exp(np.outer(values, sigma)))
    assert solver.states[:, 0] == pytest.approx(expected, abs=0.002)


def acting(offset=0.0, heading=0.0, curvature=0.0, rate=0.0, speed=10.0, turning=0.0, ahead=15.0):
    lane = Lane(offset, heading, curvature, rate, ahead)
    return Acting(lane, speed, SHUTTLE.wheelbase_m * turning, turning, turning, lane)


def law() -> Mpc:
    built = build_law(MPC, SHUTTLE)
    assert isinstance(built, Mpc)
    return built


def test_the_law_plans_on_an_ordinary_lane_and_steers_towards_its_centre():
    mpc = law()
    demanded = [mpc.curvature(acting(offset=0.3), dt_s=DT_S) for _ in range(5)]
    assert mpc.doing == "planning"
    assert demanded[-1] < demanded[0] < 0.0


@pytest.mark.parametrize("speed", [0.0, 3.0, 12.0, 30.0])
def test_lateral_acceleration_and_jerk_of_the_command_stay_within_their_limits(speed):
    mpc, draw, before = law(), np.random.default_rng(0).uniform, 0.0
    most_mps2, most_mps3 = SETTINGS.lateral.mpc.max_lateral_mps2, SETTINGS.lateral.mpc.max_jerk_mps3
    bend = min(0.05, 5.0 / max(speed, 1.0) ** 2)  # up to 5 m/s² if it were followed
    for _ in range(200):
        seen = acting(draw(-1.0, 1.0), draw(-0.1, 0.1), draw(-bend, bend), 0.0, speed, before)
        demanded = mpc.curvature(seen, dt_s=DT_S)
        assert mpc.doing == "planning"
        assert abs(demanded) * speed**2 <= most_mps2 + 1e-6
        assert abs(demanded - before) * speed**2 <= most_mps3 * DT_S + 1e-6
        before = demanded


def test_braking_in_a_bend_leaves_less_of_the_jerk_to_the_wheel():
    mpc, speed, before = law(), 10.0, None
    for _ in range(40):
        demanded = mpc.curvature(acting(offset=-0.8, curvature=0.02, speed=speed, turning=0.02), dt_s=DT_S)
        lateral = demanded * speed**2
        if before is not None:
            assert abs(lateral - before) <= SETTINGS.lateral.mpc.max_jerk_mps3 * DT_S + 1e-6
        before, speed = lateral, speed - 3.0 * DT_S


@pytest.mark.parametrize(
    "seen", [acting(heading=1.1), acting(speed=-2.0), acting(offset=4.0, curvature=0.25), acting(offset=30.0)]
)
def test_outside_the_model_the_fallback_steers_in_the_same_call(seen):
    mpc = law()
    mpc.curvature(acting(offset=0.1), dt_s=DT_S)
    assert mpc.curvature(seen, dt_s=DT_S) == build_law(LQI, SHUTTLE).curvature(seen, dt_s=DT_S)
    assert mpc.doing == "falling back: outside the model"


@pytest.mark.parametrize("seen", [acting(offset=math.nan), acting(speed=math.inf), acting(turning=-math.inf)])
def test_without_finite_inputs_the_last_command_is_held(seen):
    mpc = law()
    demanded = [mpc.curvature(acting(offset=0.3), dt_s=DT_S) for _ in range(3)]
    assert mpc.curvature(seen, dt_s=DT_S) == demanded[-1] != 0.0


class BrokenSolver:
    """A QP solver that reports success and NaN, as DAQP does on NaN, or a status of failure."""

    def __init__(self, status, value):
        self.answer = np.full(MPC.mpc.stages, value), 0.0, status, {}

    def update(self, *_):
        return 0

    def solve(self):
        return self.answer


@pytest.mark.parametrize(("status", "value"), [(1, math.nan), (-1, 0.0), (-4, math.inf)])
def test_a_failed_solution_is_never_used_and_leaves_nothing_behind(status, value):
    seen = acting(offset=0.3)
    mpc, fresh = law(), law()
    for one in (mpc, fresh):
        one.curvature(seen, dt_s=DT_S)
    mpc._solver._qp = BrokenSolver(status, value)
    demanded = mpc.curvature(seen, dt_s=DT_S)
    assert mpc.doing == "falling back: no solution"
    assert demanded == build_law(LQI, SHUTTLE).curvature(seen, dt_s=DT_S)
    fresh.release()
    fresh._demand_1pm = demanded
    assert mpc.curvature(seen, dt_s=DT_S) == fresh.curvature(seen, dt_s=DT_S)
    assert mpc.doing == "planning"


def test_the_same_states_give_the_same_commands_bit_for_bit():
    seen = [random_acting(np.random.default_rng(5)) for _ in range(50)]
    runs = [[mpc.curvature(state, dt_s=DT_S) for state in seen] for mpc in (law(), law())]
    assert runs[0] == runs[1]


def random_acting(generator):
    """Anything that messages can hold: ordinary, absurd, not a number."""
    draw = generator.uniform
    wide = 10.0 ** draw(-1.0, 2.0)
    values = [
        draw(-2.0, 2.0) * wide,
        draw(-0.5, 0.5) * wide,
        draw(-0.05, 0.05) * wide,
        draw(-0.005, 0.005) * wide,
        draw(-5.0, 40.0),
        draw(-0.1, 0.1) * wide,
        draw(0.0, 50.0),
    ]
    if draw() < 0.02:
        values[generator.integers(len(values))] = float(
            generator.choice([math.nan, math.inf, -math.inf, 1e9])
        )
    return acting(*values)


def not_finite(count, seed):
    """The number of non-finite answers to ``count`` random states, and the count of each solver status."""
    generator, mpc, bad, did = np.random.default_rng(seed), law(), 0, dict[str, int]()
    for _ in range(count):
        bad += not math.isfinite(mpc.curvature(random_acting(generator), dt_s=generator.uniform(0.0, 0.1)))
        did[mpc.doing] = did.get(mpc.doing, 0) + 1
    return bad, did


def test_ten_thousand_random_states_are_answered_with_a_number():
    bad, did = not_finite(10_000, seed=11)
    assert bad == 0
    assert did["planning"] > 1000 < did["falling back: outside the model"]


@pytest.mark.proof
def test_a_million_random_states_are_answered_with_a_number():
    seed = int(np.random.default_rng().integers(2**31))
    bad, did = not_finite(1_000_000, seed)
    print(f"seed {seed}: {did}")
    assert bad == 0


def test_casadi_is_loaded_only_when_the_law_is_chosen():
    ask = "import controller.controller, sys; print('casadi' in sys.modules, 'daqp' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", ask], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
