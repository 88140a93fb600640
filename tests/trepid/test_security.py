"""Settings of Zenoh by role: endpoints outside this machine without keys, and permission to publish."""

from pathlib import Path

import pytest

from trepid.bus import free_endpoint, open_bus
from trepid.config import CAR, InputError
from trepid.processes.settings import load_processes, published_keys
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


@pytest.mark.parametrize(
    "listen",
    ["127.0.0.1:70000", "127.0.0.1:0", "127.0.0.1", ":7447", "a..b:1", f"{'x' * 64}:1", "car?x:1", "a/b:1"],
)
def test_an_address_that_no_program_can_listen_at_is_refused_with_its_place(
    listen: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(tmp_path))
    (tmp_path / "security.yaml").write_text(f'listen: "{listen}"\n')
    with pytest.raises(InputError, match=r"security\.yaml:1:1: listen: .* is no HOST:PORT"):
        load_security()


def test_without_keys_only_the_size_of_messages_is_limited() -> None:
    assert session_settings("camera") == {"transport/link/rx/max_message_size": 16 * 2**20}


def messages_allowed(control: dict, role: str) -> list[str]:
    """Keys that ``role`` may publish by the rules of ``control``."""
    subjects = [
        subject["id"] for subject in control["subjects"] if role in subject.get("cert_common_names", ())
    ]
    rules = [
        name
        for policy in control["policies"]
        if set(subjects) & set(policy["subjects"])
        for name in policy["rules"]
    ]
    return [
        key
        for rule in control["rules"]
        if rule["id"] in rules and "put" in rule["messages"] and rule["flows"] == ["ingress"]
        for key in rule["key_exprs"]
    ]


def test_every_process_may_publish_its_topics_and_heartbeats_and_no_others() -> None:
    control = access_control({"camera": ("camera/image",), "cv": ("perception/cv/estimate",)})
    beats = ["trepid/*/diagnostics", "trepid/*/diagnostics/**"]
    assert messages_allowed(control, "camera") == ["trepid/*/camera/image", *beats]
    assert messages_allowed(control, "cv") == ["trepid/*/perception/cv/estimate", *beats]
    assert messages_allowed(control, LAUNCHER) == ["trepid/*/drive/losses", *beats]
    assert messages_allowed(control, OBSERVER) == []
    assert messages_allowed(control, "stranger") == []


def test_no_name_of_a_process_lets_others_publish_its_topics() -> None:
    """The rules of Zenoh name their parts, among them one for everyone."""
    names = [subject["id"] for subject in access_control({"all": ("controller/command",)})["subjects"]]
    assert len(set(names)) == len(names)


def test_what_no_rule_allows_is_denied() -> None:
    control = access_control({})
    assert control["enabled"]
    assert control["default_permission"] == "deny"


def test_commands_decisions_images_and_states_have_one_publisher_in_a_drive() -> None:
    publishes = published_keys(load_processes())
    for key in ("controller/command", "supervisor/decision", "camera/image", "vehicle/state"):
        assert [role for role, topics in publishes.items() if key in topics] == [key.split("/")[0]]
