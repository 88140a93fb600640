"""The tub whose commands are timed, and that they are those of the page."""

from pathlib import Path

import pytest
from page_rig import console_blocks

from learning.dataset.build import read_log
from learning.dataset.sources.log import Faults
from learning.dataset.sources.table import TableOptions

pytest.importorskip("torch", reason="needs pip install 'trepid[train]'")
from lab.bench.study.train_your_own import COMMANDS, RATE_HZ, write_drive


def test_the_commands_are_those_of_the_page() -> None:
    assert [*COMMANDS] == console_blocks("train-your-own.md")[0]


@pytest.mark.long
def test_the_tub_has_about_as_many_frames_as_asked_for_at_the_rate_of_donkeycar(tmp_path: Path) -> None:
    assert write_drive(tmp_path, 40, seed=0) == pytest.approx(40, abs=5)
    log = read_log(tmp_path / "mytub", Faults(strict=True), TableOptions())
    assert (log.t_s[-1] - log.t_s[0]) / (len(log) - 1) == pytest.approx(1 / RATE_HZ, rel=0.02)
