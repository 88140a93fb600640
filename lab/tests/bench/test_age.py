"""A stored result says that it is older than the code, by the files that it rests on."""

import subprocess
from pathlib import Path

import pytest

from lab.bench import age
from lab.bench.age import age_sentence, ages, files_of, with_ages
from lab.bench.catalogue import BENCHMARKS
from trepid.config import ROOT

CHECKOUT = pytest.mark.skipif(not (ROOT / ".git").exists(), reason="only git knows what has changed")


@pytest.fixture
def changes(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """The files that have changed since every commit; a test fills it."""
    found: set[str] = set()
    monkeypatch.setattr(age, "changes_since", lambda commit: found)
    return found


@pytest.mark.parametrize("name", BENCHMARKS)
def test_a_benchmark_rests_on_its_own_module_and_on_files_that_exist(name: str) -> None:
    files = files_of(name)
    module = f"lab/bench/{BENCHMARKS[name].module.replace('.', '/')}"
    assert f"{module}.py" in files or f"{module}/__init__.py" in files
    assert all((ROOT / path).is_file() for path in files)


def test_what_a_benchmark_runs_is_among_its_files_and_what_it_does_not_is_not() -> None:
    inference, suite = files_of("fear-inference"), files_of("suite")
    assert {"supervisor/rules/inference.py", "config/fear.yaml"} <= inference
    assert not any(path.startswith(("perception/", "learning/")) for path in inference)
    assert {"supervisor/supervisor.py", "sim_harness/lockstep/closed_loop.py"} <= suite  # by the command line


def test_a_result_is_old_where_one_of_its_files_has_changed(changes: set[str]) -> None:
    changes |= {"docs/fear.md", "perception/node.py", "README.md"}
    assert age_sentence("fear-inference", "abcdef12") == ""
    changes.add("supervisor/rules/inference.py")
    sentence = age_sentence("fear-inference", "abcdef12")
    assert (
        sentence.startswith("It is older than the code: 1 of the ")
        and "`supervisor/rules/inference.py`" in sentence
    )
    assert ages({"fear-inference": "abcdef12", "dbc": "abcdef12"}) == {"fear-inference": sentence}


def test_a_commit_that_cannot_be_compared_is_said_to_be_so(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "changes that no commit has" in age_sentence("dbc", "abcdef12+")
    monkeypatch.setattr(age, "changes_since", lambda commit: None)
    assert "abcdef12 is not known here" in age_sentence("dbc", "abcdef12")


@CHECKOUT
def test_git_knows_the_present_commit_and_no_invented_one(tmp_path: Path) -> None:
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
    assert age.changes_since(head.stdout.strip()) is not None
    assert age.changes_since("0" * 40) is None


def test_the_sentence_stands_below_the_heading_of_its_result_alone() -> None:
    page = "# Measured results\n\n## dbc\n\ntext\n\n## suite\n\ntext\n"
    aged = with_ages(page, {"suite": "It is old."})
    assert aged == page.replace("## suite\n", "## suite\n\n*It is old.*\n")
    assert with_ages(page, {}) == page
