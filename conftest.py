"""Settings of all tests."""

import gc
import os
import signal
import tempfile
from pathlib import Path

for library in (
    "OMP",
    "OPENBLAS",
    "MKL",
):  # tests run in parallel; threads of one would only wait for the other's
    os.environ.setdefault(f"{library}_NUM_THREADS", "1")

os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(
    prefix="trepid-state-"
)  # drives write their last minutes there

import cv2  # noqa: E402  after the limits, which libraries read when they are imported
import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

# Timing decides no test, on however loaded a machine. The examples are others in every run.
settings.register_profile("untimed", deadline=None, max_examples=int(os.environ.get("EXAMPLES", "40")))
settings.load_profile("untimed")
cv2.setNumThreads(1)  # here alone: the processes of a drive do as they do without tests


def pytest_configure() -> None:
    """Handle SIGINT also in the background of a script, whose children inherit that it is ignored."""
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """Spare the garbage collector the thousands of tests and modules, which stay to the end."""
    gc.collect()
    gc.freeze()


@pytest.fixture
def own_register(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A register of drives, in ``$XDG_RUNTIME_DIR``, which no other drive of this machine is in; that folder."""
    runtime = tmp_path / "runtime"
    for folder in (runtime, tmp_path / "temporary"):
        folder.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    return runtime
