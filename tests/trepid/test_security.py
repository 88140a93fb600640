"""Settings of Zenoh by role: what leaves this machine without keys, and who may publish what, is decided here."""

from pathlib import Path

import pytest

from trepid.bus import free_endpoint, open_bus
from trepid.config import CAR, InputError
from trepid.security import (
    LAUNCHER,
    OBSERVER,
    access_control,
    drive_endpoint,
    load_security,
    on_loopback,
    refuse_open_endpoints,
    session_settings,
)
from trepid.topics import FIXED

CLOCK = lambda: 0.0  # noqa: E731


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/127.0.0.1:7447", "tcp/127.8.8.8:1", "tls/[::1]:7447", "tcp/localhost:1", "unixsock-stream//tmp/a"],
)
def test_the_loopback_interface_is_recognised(endpoint: str) -> None:
    assert on_loopback(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/192.168.1.10:7447", "udp/car.local:7447", "tcp/eth0"],
)
def test_an_endpoint_elsewhere_without_keys_is_refused_with_the_remedy(endpoint: str) -> None:
    assert not on_loopback(endpoint)
    with (
        pytest.raises(InputError, match=r"leaves this machine without keys; `trepid keys create DIR`"),
        open_bus("car", CLOCK, listen=endpoint),
    ):
        pass


def test_tls_without_certificates_of_both_sides_is_no_key() -> None:
    settings = {"listen/endpoints": ["tls/10.0.0.1:7447"], "connect/endpoints": []}
    with pytest.raises(InputError):
        refuse_open_endpoints(settings)
    with pytest.raises(InputError):
        refuse_open_endpoints(settings | {"transport/link/tls": {"enable_mtls": False}})
    refuse_open_endpoints(settings | {"transport/link/tls": {"enable_mtls": True}})


def test_the_address_of_a_drive_is_that_of_the_settings_of_the_car(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = free_endpoint()
    assert drive_endpoint(free) == free
    (tmp_path / "security.yaml").write_text("listen: 192.168.1.10:7447\n")
    monkeypatch.setenv(CAR, str(tmp_path))
    assert drive_endpoint(free) == "tcp/192.168.1.10:7447"  # the bus refuses it
    (tmp_path / "security.yaml").write_text("listen: 192.168.1.10:7447\nkeys: keys\n")
    assert drive_endpoint(free) == "tls/192.168.1.10:7447"
    assert load_security().folder == tmp_path / "keys"


def test_without_keys_only_the_size_of_messages_is_limited() -> None:
    assert session_settings("camera") == {"transport/link/rx/max_message_size": 16 * 2**20}


def test_every_command_decision_image_and_state_has_exactly_one_publisher() -> None:
    security = load_security()
    publishers = {key: [role for role in security.publishes if key in security.topics(role)] for key in FIXED}
    for key in ("controller/command", "supervisor/decision", "camera/image", "vehicle/state"):
        assert publishers[key] == [key.split("/")[0]]


def test_a_process_without_an_entry_publishes_its_own_estimate_only() -> None:
    assert "perception/mine/estimate" in load_security().topics("mine")
    assert not any("yours" in key or "command" in key for key in load_security().topics("mine"))


@pytest.mark.parametrize("role", [LAUNCHER, OBSERVER])
def test_launcher_and_observers_publish_nothing(role: str) -> None:
    assert load_security().topics(role) == ()
    control = access_control(load_security(), [role])
    assert not any("put" in rule["messages"] and "ingress" in rule["flows"] for rule in control["rules"])


def test_what_no_rule_allows_is_denied() -> None:
    control = access_control(load_security(), ["controller"])
    assert control["enabled"]
    assert control["default_permission"] == "deny"
