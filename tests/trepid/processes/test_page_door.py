"""The address of the live page: one token for all drives of a user, and beyond this machine only with keys."""

import socket
import subprocess
import sys
import tempfile

import pytest

from trepid.config import InputError, use_car
from trepid.processes.page_door import TOKEN, TOKEN_FILE, page_door, page_token
from trepid.processes.register import folder


@pytest.fixture(autouse=True)
def _own_register(own_register, monkeypatch):
    monkeypatch.delenv(TOKEN, raising=False)


def test_the_token_is_long_kept_and_readable_by_its_owner_alone():
    token = page_token()
    assert len(token) >= 20 and page_token() == token
    assert (folder() / TOKEN_FILE).stat().st_mode & 0o777 == 0o600
    assert [path.name for path in folder().iterdir()] == [TOKEN_FILE]


def test_the_token_is_the_same_for_a_service_of_the_system_and_the_shell_of_its_user(monkeypatch):
    with monkeypatch.context() as service:
        service.delenv("XDG_RUNTIME_DIR")
        token = page_token()
    assert page_token() == token


def test_where_no_folder_can_hold_the_token_the_processes_of_the_drive_inherit_it(monkeypatch, tmp_path):
    monkeypatch.setenv(TOKEN, "")  # restored after the test
    monkeypatch.delenv(TOKEN)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    door = page_door("127.0.0.1", 0)
    printed = "from trepid.processes.page_door import page_token; print(page_token())"
    page = subprocess.run([sys.executable, "-c", printed], capture_output=True, text=True, check=True)
    assert len(door.token) >= 20 and page.stdout.strip() == door.token


def test_a_port_is_used_where_no_folder_can_hold_its_lock(monkeypatch, tmp_path):
    monkeypatch.setenv(TOKEN, "any")
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "missing"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "missing"))
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    assert page_door("127.0.0.1", port).port == port


def test_the_token_is_no_part_of_a_request():
    door = page_door("127.0.0.1", 0)
    assert door.url == f"http://127.0.0.1:{door.port}/#{door.token}"


def test_a_port_in_use_gives_way_to_a_free_one_unless_it_was_asked_for():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        assert page_door("127.0.0.1", port).port not in (0, port)
        with pytest.raises(InputError, match=f"--page {port}: the port is in use"):
            page_door("127.0.0.1", port, only=True)


def test_two_drives_that_start_at_once_take_two_ports():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    drive = "from trepid.processes.page_door import page_door"
    drive += f"; print(page_door('127.0.0.1', {port}).port, flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", drive], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:  # its page does not listen yet
        assert int(other.stdout.readline()) == port
        assert page_door("127.0.0.1", port).port not in (0, port)
        other.communicate("\n")
    assert page_door("127.0.0.1", port).port == port == page_door("127.0.0.1", port).port


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "car.example"])
def test_an_address_beyond_this_machine_is_refused_without_keys(host):
    with pytest.raises(
        InputError, match=r"drive\.yaml:\d+:\d+: page_host: .* leaves this machine without keys"
    ):
        page_door(host, 0)


def test_with_keys_the_page_is_served_over_tls(tmp_path):
    car = tmp_path / "car"
    car.mkdir()
    (car / "security.yaml").write_text("keys: keys\n")
    try:
        use_car(car)
        door = page_door("0.0.0.0", 0)
        assert door.url.startswith("https://") and door.keys == (car / "keys/page.crt", car / "keys/page.key")
    finally:
        use_car(None)
