"""The endpoint of a drive is one at which it can listen, or the line that says why not."""

import socket
from pathlib import Path

import pytest

from trepid.bus import open_bus
from trepid.config import CAR, InputError
from trepid.processes.endpoint import usable_endpoint
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
