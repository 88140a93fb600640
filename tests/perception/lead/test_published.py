"""Detectors that are fetched by name: the bytes of the publisher, or one line and no file."""

import hashlib
import io
import tarfile
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from perception.lead import published
from perception.lead.finder import lead_settings, make_detector
from perception.lead.published import PUBLISHED, REGISTRY_VARIABLE, fetch, fetched_detector, file_of
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

MODEL = b"TFL3" + bytes(range(200))
NAME = "objectron"


def package(member: str, content: bytes) -> bytes:
    """A package of npm with one file."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        about = tarfile.TarInfo(member)
        about.size = len(content)
        archive.addfile(about, io.BytesIO(content))
    return packed.getvalue()


class Registry(BaseHTTPRequestHandler):
    """Answers every request with the same bytes."""

    answer = b""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        self.wfile.write(self.answer)

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def registry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[type[Registry]]:
    """A registry of this machine, an empty data folder, and a detector of 204 bytes."""
    small = PUBLISHED[NAME]._replace(start=3, size=len(MODEL), sha256=hashlib.sha256(MODEL).hexdigest())
    monkeypatch.setitem(published.PUBLISHED, NAME, small)
    server = HTTPServer(("127.0.0.1", 0), Registry)
    monkeypatch.setenv(REGISTRY_VARIABLE, f"http://127.0.0.1:{server.server_port}")
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield Registry
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_fetched_detector_has_the_bytes_of_its_publisher(registry: type[Registry]) -> None:
    registry.answer = package(PUBLISHED[NAME].member, b"abc" + MODEL + b"more")
    assert fetch(NAME).read_bytes() == MODEL
    assert fetched_detector(NAME) == file_of(NAME)


@pytest.mark.parametrize(
    ("answer", "reason"),
    [
        (package(PUBLISHED[NAME].member, b"abc" + MODEL[::-1]), "SHA-256"),
        (package("package/other", MODEL), "no package with"),
        (b"not an archive", "no package with"),
        (b"", "no package with"),
    ],
)
def test_another_answer_is_one_line_and_leaves_no_file(
    registry: type[Registry], answer: bytes, reason: str
) -> None:
    registry.answer = answer
    with pytest.raises(InputError, match=reason):
        fetch(NAME)
    assert not file_of(NAME).parent.exists()


def test_without_its_registry_a_detector_is_one_line(
    registry: type[Registry], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(REGISTRY_VARIABLE, "http://127.0.0.1:9")
    with pytest.raises(InputError, match="cannot be read"):
        fetch(NAME)


def test_a_name_in_the_settings_that_was_not_fetched_names_the_command(registry: type[Registry]) -> None:
    settings = lead_settings().model_copy(update={"detector": Path(NAME)})
    with pytest.raises(InputError, match=f"trepid detector fetch {NAME}"):
        make_detector(settings, load(CONFIG_DIR / "camera.yaml", Camera))


def test_a_detector_is_given_by_its_name_or_as_a_file() -> None:
    assert lead_settings(Path(NAME)).detector == Path(NAME)
    assert lead_settings(Path("own.onnx")).detector == Path.cwd() / "own.onnx"


def test_a_changed_file_is_refused(registry: type[Registry]) -> None:
    registry.answer = package(PUBLISHED[NAME].member, b"abc" + MODEL)
    path = fetch(NAME)
    path.write_bytes(MODEL + b"x")
    with pytest.raises(InputError, match="not the detector"):
        fetched_detector(NAME)


def test_the_scores_of_the_published_detector_become_probabilities() -> None:
    probability = PUBLISHED[NAME].layout.calibration
    assert probability(0.3) == pytest.approx(0.5, abs=0.02)
    assert probability(0.2) < 0.15 and probability(0.5) > 0.95
