"""The endpoint of a drive is one at which it can listen, or the line that says why not."""

import os
import shutil
import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from trepid.bus import open_bus
from trepid.config import CAR, InputError
from trepid.processes.endpoint import reserve_port, usable_endpoint
from trepid.security import on_loopback


@pytest.fixture
def security(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CAR, str(tmp_path))
    return tmp_path / "security.yaml"


def test_without_settings_it_is_a_free_port_of_this_machine() -> None:
    assert on_loopback(usable_endpoint())
    with open_bus("car", lambda: 0.0, listen=usable_endpoint()):
        pass


def test_an_address_of_ipv6_can_be_used(security: Path) -> None:
    try:
        with socket.socket(socket.AF_INET6) as probe:
            probe.bind(("::1", 0))
            port = probe.getsockname()[1]
    except OSError:
        pytest.skip("this machine has no IPv6")
    security.write_text(f'listen: "[::1]:{port}"\n')
    assert usable_endpoint() == f"tcp/[::1]:{port}"


def test_a_port_in_use_and_an_address_beyond_this_machine_are_refused_with_their_place(
    security: Path,
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        security.write_text(f"\nlisten: 127.0.0.1:{other.getsockname()[1]}\n")
        with pytest.raises(
            InputError, match=rf"^{security}:2:1: listen: .* cannot be used: .*; give another"
        ):
            usable_endpoint()
    security.write_text("listen: 192.0.2.7:7447\n")
    with pytest.raises(InputError, match=rf"^{security}:1:1: listen: .* leaves this machine without keys"):
        usable_endpoint()


ENDPOINT = "from trepid.processes.endpoint import reserve_port, usable_endpoint; print(usable_endpoint())"


def test_where_the_loopback_interface_is_down_the_line_says_so_at_once() -> None:
    """A network of its own has an interface lo that is down, as minimal images have."""
    alone = ["unshare", "--user", "--map-root-user", "--net"]
    if (
        shutil.which("unshare") is None
        or subprocess.run([*alone, "true"], capture_output=True, check=False).returncode
    ):
        pytest.skip("this machine makes no network namespaces")
    command = [*alone, sys.executable, "-c", ENDPOINT]
    said = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False).stderr
    assert "127.0.0.1 cannot be reached: Network is unreachable" in said
    assert "`ip link set lo up`" in said


def test_a_port_that_another_process_has_taken_but_does_not_use_yet_is_refused(security: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    security.write_text(f"listen: 127.0.0.1:{port}\n")
    taking = f"{ENDPOINT}; import sys; sys.stdout.flush(); input()"
    with subprocess.Popen(
        [sys.executable, "-c", taking], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline().strip() == f"tcp/127.0.0.1:{port}"
        with pytest.raises(InputError, match=r"security\.yaml:1:\d+: listen: .*Address already in use"):
            usable_endpoint()
        other.communicate("\n")
    assert usable_endpoint() == f"tcp/127.0.0.1:{port}"


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
def test_a_port_that_another_user_has_taken_but_does_not_use_yet_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    assert reserve_port("127.0.0.1", port) == port
    code = f"reserve_port('127.0.0.1', {port})"
    program = f"import os\nfrom trepid.processes.endpoint import reserve_port\nos.setuid(65534)\n{code}"
    errors = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    ).stderr
    assert errors.endswith("Address already in use\n")


def test_shared_memory_that_is_missing_full_or_read_only_is_refused_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("trepid.processes.endpoint.SHARED_MEMORY", tmp_path)
    assert on_loopback(usable_endpoint())
    monkeypatch.setattr("shutil.disk_usage", lambda folder: SimpleNamespace(free=4096))
    with pytest.raises(
        InputError, match=r"0\.0 MB are free, a drive needs 32 MB of shared memory; .*--shm-size"
    ):
        usable_endpoint()
    monkeypatch.setattr("trepid.processes.endpoint.SHARED_MEMORY", tmp_path / "none")
    with pytest.raises(InputError, match=r"none: no such folder; a drive needs shared memory"):
        usable_endpoint()
    monkeypatch.setattr("trepid.processes.endpoint.SHARED_MEMORY", Path("/proc"))
    with pytest.raises(InputError, match=r"^/proc cannot be used: .*; a drive needs shared memory"):
        usable_endpoint()
