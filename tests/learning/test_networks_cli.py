"""`trepid networks`: described networks, fetched once, or one line and no file."""

import hashlib
from pathlib import Path

import pytest
from segment_rig import write_network
from typer.testing import CliRunner

from learning.networks_cli import app
from perception.segments.settings import fetched_file
from trepid.config import InputError

DESCRIPTION = """description: colours of drawn roads
source: tests
licence: MIT
input: {{name: x, width: 320, height: 192}}
lines: {{output: lines, channels: [1]}}
fetch: {{address: "{address}", sha256: "{sha256}"}}
"""


@pytest.fixture
def published_network(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A car with a description of the network `colours`, whose publisher is a file of this machine."""
    network = write_network(tmp_path / "published.onnx")
    (tmp_path / "car" / "networks").mkdir(parents=True)
    text = DESCRIPTION.format(
        address=network.as_uri(), sha256=hashlib.sha256(network.read_bytes()).hexdigest()
    )
    (tmp_path / "car" / "networks" / "colours.yaml").write_text(text)
    monkeypatch.setenv("TREPID_CAR", str(tmp_path / "car"))
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return network


def run(*words: str) -> str:
    found = CliRunner().invoke(app, words, catch_exceptions=True)
    if found.exception is not None:
        raise found.exception
    return found.output


def test_a_fetched_network_has_the_bytes_of_its_publisher(published_network: Path) -> None:
    assert "file     not fetched" in run("list").split("twinlitenet")[0]
    said = run("fetch", "colours")
    assert fetched_file("colours").read_bytes() == published_network.read_bytes()
    assert published_network.as_uri() in said and "licence: MIT" in said and "sha256 " in said
    assert str(fetched_file("colours")) in run("list")


def test_other_bytes_of_the_publisher_are_refused_and_leave_no_file(published_network: Path) -> None:
    published_network.write_bytes(published_network.read_bytes() + b"x")
    with pytest.raises(InputError, match=r"its SHA-256 is \w+, expected "):
        run("fetch", "colours")
    assert not fetched_file("colours").exists()


def test_a_copy_of_the_user_counts_where_it_is_the_described_network(
    published_network: Path, tmp_path: Path
) -> None:
    run("fetch", "colours", "--file", str(write_network(tmp_path / "own.onnx", bias=0.5)))
    assert fetched_file("colours").read_bytes() == (tmp_path / "own.onnx").read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("other.onnx", b"not a network", "other.onnx: not an ONNX network"),
        ("other.pth", b"not a network", "other.pth: its SHA-256 is"),
        ("none.onnx", None, "none.onnx: no such file"),
        ("none.pth", None, "none.pth: cannot be read: No such file"),
    ],
)
def test_another_copy_is_one_line_and_leaves_no_file(
    published_network: Path, tmp_path: Path, name: str, content: bytes | None, problem: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=problem):
        run("fetch", "colours", "--file", str(tmp_path / name))
    assert not fetched_file("colours").exists()


def test_an_unknown_name_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(InputError, match="no network 'twinlite'; did you mean 'twinlitenet'"):
        run("fetch", "twinlite")


def test_a_network_without_an_address_takes_a_file_alone(published_network: Path) -> None:
    description = published_network.parent / "car" / "networks" / "colours.yaml"
    description.write_text(description.read_text().split("fetch:")[0])
    with pytest.raises(InputError, match=r"names no address; `--file F\.onnx` takes a file"):
        run("fetch", "colours")
