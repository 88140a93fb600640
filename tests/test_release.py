"""What a release carries agrees with the project: versions, lock file, container, cards of the networks."""

import json
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import trepid
from trepid.config import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCKED = re.compile(r"^([\w.-]+)==(\S+)(?: ;.*)? \\$", re.MULTILINE)
WEIGHTS = sorted((ROOT / "perception" / "weights").glob("*.onnx"))
ENGINES = [name for name in ("podman", "docker") if shutil.which(name)]


def locked_versions() -> dict[str, str]:
    """Package -> version in requirements.lock."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    return {normal(name): version for name, version in LOCKED.findall(text)}


def normal(name: str) -> str:
    """The name of a package as indices compare it (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def test_every_place_that_names_the_version_names_the_same() -> None:
    laboratory = tomllib.loads((ROOT / "lab" / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    assert cited is not None
    assert {trepid.__version__, PROJECT["version"], laboratory["version"], cited.group(1)} == {
        PROJECT["version"]
    }
    assert f"## [{PROJECT['version']}] - " in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("dependency", PROJECT["dependencies"])
def test_the_lock_file_fulfils_each_dependency(dependency: str) -> None:
    wanted = Requirement(dependency)
    assert locked_versions()[normal(wanted.name)] in wanted.specifier


def test_the_lock_file_has_the_versions_that_are_tested_and_names_no_machine() -> None:
    text = (ROOT / "constraints.txt").read_text(encoding="utf-8")
    lines = [line.split("==") for line in text.splitlines() if "==" in line]
    tested = {normal(name): version for name, version in lines}
    assert len(locked_versions()) > 30
    assert {
        name for name, version in locked_versions().items() if tested.get(name, version) != version
    } == set()
    assert "file:" not in (ROOT / "requirements.lock").read_text(encoding="utf-8")


@pytest.mark.parametrize("weights", WEIGHTS, ids=lambda path: path.stem)
def test_the_card_of_a_network_is_that_of_the_shipped_weights(weights: Path) -> None:
    record = json.loads(weights.with_suffix(".json").read_text(encoding="utf-8"))
    page = (ROOT / "docs" / "models.md").read_text(encoding="utf-8")
    card = page.split(f"## {weights.stem}")[1].split("\n## ")[0]
    assert f"sha256 `{record['sha256'][:12]}…`" in card
    assert f"{record['parameters']} weights" in card
    assert record["command"].split(" --device")[0].split(";")[0] in card
    assert "Apache-2.0" in page


def test_a_release_of_a_tree_with_changes_is_refused(tmp_path: Path) -> None:
    subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
    for name in (".ci/release", "pyproject.toml"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    done = subprocess.run(
        [tmp_path / ".ci" / "release", "--check"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "not clean" in done.stderr


@pytest.mark.wheel
@pytest.mark.skipif(not ENGINES, reason="neither podman nor docker")
def test_the_container_drives_in_lock_step() -> None:
    engine = ENGINES[0]
    if subprocess.run([engine, "info"], capture_output=True, check=False).returncode:
        pytest.skip(f"{engine} does not answer here")
    built = subprocess.run(
        [engine, "build", "-q", "-t", "trepid-test", "-f", "Containerfile", "."],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    run = [engine, "run", "--rm", "trepid-test", "sim", "run", "straight", "--set", "sight=truth", "--json"]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert json.loads(done.stdout)["departures"] == 0, done.stderr
