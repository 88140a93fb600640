"""The bench of MPC against acados: same problems, same optimum."""

from itertools import pairwise

import numpy as np
import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from controller.laws.lateral import LawName
from controller.laws.mpc_solver import Solver
from lab.bench.control import mpc as bench
from lab.bench.control.acados_peer import CONFIGURATIONS, Acados, missing
from lab.bench.control.contestants import with_law
from lab.bench.control.episode import drive, s_curve


def test_a_missing_acados_is_reported_with_the_command_that_installs_it(monkeypatch, tmp_path):
    monkeypatch.setenv("TREPID_ACADOS", str(tmp_path))
    assert "make acados" in (missing() or "")


def test_the_problems_are_those_of_a_drive_and_depend_on_the_seed_only(monkeypatch):
    monkeypatch.setattr(bench, "SPEEDS_MPS", (16.0,))
    monkeypatch.setattr(bench, "DURATION_S", 3.0)
    problems, again, other = (bench.record_calls(SETTINGS, seed) for seed in (1, 1, 2))
    assert len(problems) >= 140
    assert problems == again != other
    assert all(abs(b.now.offset_m - a.now.offset_m) < 0.2 for a, b in pairwise(problems))


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
@pytest.mark.parametrize("name", list(CONFIGURATIONS))
def test_acados_finds_the_same_plan(monkeypatch, tmp_path, name):
    monkeypatch.setattr(bench, "SPEEDS_MPS", (16.0,))
    monkeypatch.setattr(bench, "DURATION_S", 0.5)
    grid, soft = bench.grid_and_soft(SETTINGS.lateral.mpc)
    peer = Acados(tmp_path, "lane_keeping_test", grid, soft, CONFIGURATIONS[name])
    for problems in bench.record_calls(SETTINGS, 3)[::5]:
        ours = Solver(grid, soft)
        for _ in range(12):
            plan = ours.solve(problems.now)
            peer.prepare(problems.now, shift=0.0, scale=1.0)
            assert peer.solve() == 0
        assert peer.plan() == pytest.approx(np.array(plan), abs=3e-4)  # HPIPM stops there


def test_the_bends_of_an_s_are_kept_within_a_centimetre():
    assert drive(s_curve(20.0, SHUTTLE), with_law(SETTINGS, LawName.MPC)).worst_m <= 0.010
