"""A recording is played onto the bus, or one line says why not."""

import socket
from pathlib import Path

import pytest
from typer.testing import CliRunner

from cockpit.replay.play import play
from trepid.cli import app
from trepid.config import CAR, InputError
from trepid.messages import Diagnostic, Health
from trepid.recording.writer import Recording
from trepid.topics import DIAGNOSTICS
from trepid.wire import to_cdr


@pytest.fixture
def recording(tmp_path: Path, own_register: Path) -> Path:
    path = tmp_path / "drive.mcap"
    beat = Diagnostic(t_s=1.0, process="cv", health=Health.OK, message="", values=())
    with Recording(path) as writing:
        writing.add(DIAGNOSTICS.key, to_cdr(beat), at_s=1.0)
    return path


@pytest.fixture
def car(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, str(tmp_path))
    return tmp_path


def test_every_message_is_played(recording: Path) -> None:
    count = play(recording, rate=1.0, vehicle_name="car", say=lambda _: None, running=lambda: True)
    assert count == 1


def test_an_endpoint_in_use_is_one_line_with_its_place(recording: Path, car: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        (car / "security.yaml").write_text(f"listen: 127.0.0.1:{other.getsockname()[1]}\n")
        with pytest.raises(InputError, match=r"security\.yaml:1:1: listen: .* cannot be used"):
            play(recording, rate=1.0, vehicle_name="car", say=lambda _: None, running=lambda: True)


def test_a_missing_name_of_the_vehicle_is_one_line(recording: Path, car: Path) -> None:
    (car / "drive.yaml").write_text("vehicle_name: null\n")
    with pytest.raises(InputError, match=r"drive\.yaml:1:1: 'vehicle_name' is missing"):
        CliRunner().invoke(app, ["replay", str(recording)], standalone_mode=False, catch_exceptions=False)
