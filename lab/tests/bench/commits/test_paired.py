"""Two commits are compared by the ratio of each turn, and nothing of the other commit stays."""

import os
import signal
import subprocess
from pathlib import Path

import pytest

from lab.bench.cli import bench
from lab.bench.commits import paired
from trepid.config import InputError

ECHO = "import sys\nfor _ in sys.stdin:\n    print({}, flush=True)\n"


@pytest.fixture
def two_commits(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A clone whose last commit but one has the scenario circuit alone."""
    scenarios = tmp_path / "config" / "scenarios"
    scenarios.mkdir(parents=True)
    who = ("-c", "user.name=n", "-c", "user.email=e@localhost")
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    for road in paired.ROADS:
        (scenarios / f"{road}.yaml").touch()
        subprocess.run(["git", "add", "."], cwd=tmp_path, check=True)
        subprocess.run(["git", *who, "commit", "-q", "-m", road], cwd=tmp_path, check=True)
    monkeypatch.setattr(paired, "ROOT", tmp_path)
    monkeypatch.setattr(paired, "WORKER", tmp_path / "worker.py")
    return tmp_path


def test_the_ratio_is_that_of_each_turn_so_that_load_which_comes_and_goes_cancels() -> None:
    load = [1.0, 1.0, 4.0, 4.0, 2.0, 2.0]
    calls = iter(load)
    row = paired.compare(lambda: 0.006 * next(calls), lambda: 0.005 * next(calls), turns=3)
    assert row["ratio"] == pytest.approx(1.2)
    assert (row["here [ms]"], row["there [ms]"]) == (12.0, 10.0)


def test_a_road_that_the_other_commit_does_not_have_is_left_out(two_commits: Path) -> None:
    (two_commits / "worker.py").write_text(ECHO.format("0.5"))
    assert list(paired.against_commit("drive", "HEAD^")) == ["drive, circuit"]
    rows = paired.against_commit("drive", "HEAD")
    assert [row["ratio"] for row in rows.values()] == [1.0, 1.0]


def test_a_tree_that_does_not_run_is_refused_with_its_last_line(two_commits: Path) -> None:
    (two_commits / "worker.py").write_text("raise ImportError('no such module')")
    with pytest.raises(InputError, match="do not run with these libraries: ImportError: no such module"):
        paired.against_commit("frame", "HEAD")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_files_of_the_commit_are_removed_after_an_interruption(two_commits: Path, number: int) -> None:
    with pytest.raises(KeyboardInterrupt), paired.files_of("HEAD^") as tree:
        assert [path.name for path in tree.rglob("*.yaml")] == ["circuit.yaml"]
        os.kill(os.getpid(), number)
    assert not tree.exists()
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_an_unknown_commit_a_folder_that_is_no_clone_and_storing_are_refused(
    two_commits: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="git knows no commit 'former' here"):
        bench(["lockstep"], against="former")
    with pytest.raises(InputError, match="is not stored: leave out --save"):
        bench(["lockstep"], against="HEAD", save_in=two_commits)
    monkeypatch.setattr(paired, "ROOT", tmp_path_factory.mktemp("installed"))
    with pytest.raises(InputError, match="needs git and a clone"):
        bench(["renderer"], against="HEAD")
