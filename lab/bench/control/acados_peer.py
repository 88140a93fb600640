"""acados on the problem of :mod:`controller.laws.mpc`: the same stages, weights, limits and soft lane.

acados generates C from casadi's expressions and compiles it with gcc. Its wheel (PyPI ``comma-deps-acados``) brings
a casadi of its own under the same name, so it is kept out of the environment, in a folder of its own (``make
acados``), of which only acados is imported; ``TREPID_ACADOS`` names another folder.
"""

import contextlib
import ctypes
import importlib
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from controller.laws.mpc_model import Grid, Problem, command_bounds, preview, stage
from controller.laws.mpc_solver import Soft
from trepid.config import ROOT

CONFIGURATIONS: dict[str, dict[str, Any]] = {
    "acados, partial condensing (its default)": {"qp_solver": "PARTIAL_CONDENSING_HPIPM"},
    "acados, full condensing": {"qp_solver": "FULL_CONDENSING_HPIPM", "hpipm_mode": "SPEED"},
}
_LIBRARIES = ("libqpOASES_e.so.3.1", "libblasfeo.so", "libhpipm.so", "libacados.so")


def missing() -> str | None:
    """The reason why acados cannot run on this machine; None if it can."""
    if not (_package() / "install").is_dir():
        return f"acados is not in {_package()}: `make acados` brings it"
    if shutil.which("gcc") is None:
        return "no gcc, which acados compiles its solvers with"
    return None


def _package() -> Path:
    return Path(os.environ.get("TREPID_ACADOS", ROOT / ".venv-acados")) / "acados"


class Acados:
    """One configuration, built in ``folder`` once, for real-time iterations."""

    def __init__(self, folder: Path, name: str, grid: Grid, soft: Soft, options: dict[str, Any]) -> None:
        with _on_stderr():
            self._solver = _build(folder, name, grid, soft, options)
        self._grid = grid
        self._preview, self._command_bounds = preview(grid), command_bounds(grid)

    def prepare(self, now: Problem, *, shift: float, scale: float) -> None:
        """Set the problem and the initial guess: the last solution, shifted."""
        n, solver = self._grid.stages, self._solver
        bends, aims, rates = (np.array(value) for value in self._preview(now))
        most = np.array(self._command_bounds(now)).ravel()
        self._move_on(shift, scale)
        for bound in ("lbx", "ubx"):
            solver.set(0, bound, np.array(now[:4]))
        for k in range(n):
            solver.set(k, "p", np.array([bends[0, k], bends[0, k + 1], now.length_m, now.lag]))
            solver.set(k, "yref", np.array([*aims[:, k], rates[0, k]]))
            solver.set(k, "lbu", np.array([now.rate_low]))
            solver.set(k, "ubu", np.array([now.rate_high]))
            if k > 0:
                highest = np.array([now.most_offset_m, most[k - 1]])
                solver.set(k, "lbx", -highest)
                solver.set(k, "ubx", highest)
        solver.set(n, "yref", aims[:, n])
        solver.set(n, "lbx", -most[n - 1 :])
        solver.set(n, "ubx", most[n - 1 :])

    def _move_on(self, shift: float, scale: float) -> None:
        solver, n = self._solver, self._grid.stages
        plan = self.plan()
        plan[:-1] += min(shift, 1.0) * (plan[1:] - plan[:-1])
        for k, w in enumerate(scale * plan):
            solver.set(k, "u", np.array([w]))
        states = np.array([solver.get(k, "x") for k in range(n + 1)])
        states[:-1] += min(shift, 1.0) * (states[1:] - states[:-1])
        for k, x in enumerate(states):
            solver.set(k, "x", x)

    def solve(self) -> int:
        """One real-time iteration; acados's status."""
        return int(self._solver.solve())

    def plan(self) -> NDArray[np.float64]:
        """w (N,)."""
        return np.array([float(self._solver.get(k, "u")[0]) for k in range(self._grid.stages)])


def _build(folder: Path, name: str, grid: Grid, soft: Soft, options: dict[str, Any]) -> Any:
    acados = _import_acados(folder)
    ocp, model = acados.AcadosOcp(), acados.AcadosModel()
    model.name = name
    model.x, model.u, model.p = ca.SX.sym("x", 4), ca.SX.sym("w"), ca.SX.sym("p", 4)
    model.disc_dyn_expr = stage(grid.h)(model.x, model.u, *ca.vertsplit(model.p))
    ocp.model, ocp.dims.N = model, grid.stages
    ocp.parameter_values = np.array([0.0, 0.0, 5.0, 0.2])
    _state_cost(ocp.cost, grid, soft)
    _state_limits(ocp.constraints)
    settings = ocp.solver_options
    settings.integrator_type, settings.hessian_approx = "DISCRETE", "GAUSS_NEWTON"
    settings.nlp_solver_type = "SQP_RTI"
    settings.tf = float(grid.stages)  # acados weights the cost of a stage with its duration
    settings.ext_fun_compile_flags = "-O3 -march=native"
    for option, value in options.items():
        setattr(settings, option, value)
    ocp.code_export_directory = str(folder / name)
    return acados.AcadosOcpSolver(ocp, json_file=str(folder / f"{name}.json"), verbose=False)


def _state_cost(cost: Any, grid: Grid, soft: Soft) -> None:
    cost.cost_type = cost.cost_type_e = "LINEAR_LS"
    cost.W, cost.W_e = grid.h * np.diag(grid.weights()), np.array(grid.terminal())
    cost.Vx, cost.Vu = np.eye(4)[:, :4] * [1.0, 1.0, 1.0, 0.0], np.eye(4)[:, 3:]
    cost.Vx_e = np.eye(3, 4)
    cost.yref, cost.yref_e = np.zeros(4), np.zeros(3)
    cost.zl = cost.zu = np.array([grid.h * soft.linear])
    cost.Zl = cost.Zu = np.array([grid.h * soft.quadratic])


def _state_limits(limits: Any) -> None:
    """Bounded quantities; the bounds come with every problem."""
    limits.x0 = np.zeros(4)
    limits.idxbu, limits.lbu, limits.ubu = np.array([0]), -np.ones(1), np.ones(1)
    limits.idxbx, limits.lbx, limits.ubx = np.array([0, 3]), -np.ones(2), np.ones(2)
    limits.idxsbx = np.array([0])
    limits.idxbx_e, limits.lbx_e, limits.ubx_e = np.array([3]), -np.ones(1), np.ones(1)


def _import_acados(folder: Path) -> Any:
    """acados's template package, in the folder layout of its sources."""
    package = _package()
    links = {name: package / "install" / name for name in ("lib", "include", "bin")}
    links["interfaces/acados_template/acados_template"] = package / "acados_template"
    for name, target in links.items():
        link = folder / "acados" / name
        link.parent.mkdir(parents=True, exist_ok=True)
        if not link.exists():
            link.symlink_to(target)
    os.environ["ACADOS_SOURCE_DIR"] = str(folder / "acados")
    for library in _LIBRARIES:  # its solvers look for these by name only
        ctypes.CDLL(str(package / "install" / "lib" / library), mode=ctypes.RTLD_GLOBAL)
    if str(package) not in sys.path:
        sys.path.append(str(package))
    return importlib.import_module("acados_template")


@contextlib.contextmanager
def _on_stderr() -> Iterator[None]:
    """Redirect the output of acados and its tools to stderr, since stdout may carry JSON."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
