"""The requests of the page: who may make them, what they answer, and that a slow viewer gets no queue."""

import hashlib
import json
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from live_page_rig import LivePage, Publisher, Scene, rule_copy
from message_rig import decision
from process_rig import until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect

from cockpit.page.hub import MAX_VIEWERS
from cockpit.page.rules import Conflict, RuleDesk
from cockpit.page.server import MAX_BODY, TOO_MANY, WRONG_ORIGIN, WRONG_TOKEN, KeepDesk
from trepid.config import CONFIG_DIR, InputError, place_of_edit, use_car
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording
from trepid.topics import DECISION
from trepid.wire import to_cdr


@pytest.fixture(scope="module")
def page_and_publisher(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[LivePage, Publisher]]:
    folder = tmp_path_factory.mktemp("server")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_RUNTIME_DIR", str(folder))
        with (
            LivePage(rule_copy(folder)) as page,
            page.bus() as bus,
            Publisher(bus, page.clock, Scene()) as publisher,
        ):
            page.start()
            yield page, publisher


@pytest.fixture
def page(page_and_publisher: tuple[LivePage, Publisher]) -> LivePage:
    return page_and_publisher[0]


@contextmanager
def stream(page: LivePage, token: str | None = None, **more: Any) -> Iterator[ClientConnection]:
    with connect(f"ws://127.0.0.1:{page.door.port}/stream", proxy=None, **more) as socket:
        with suppress(ConnectionClosed):  # refused before its greeting
            socket.send(json.dumps({"token": page.door.token if token is None else token}))
        yield socket


def state_of(message: bytes | str) -> dict[str, Any]:
    assert isinstance(message, bytes)
    (length,) = struct.unpack_from(">I", message)
    return dict(json.loads(message[4 : 4 + length]))


def end_of(socket: ClientConnection) -> int:
    with pytest.raises(ConnectionClosed) as ended:
        socket.recv(timeout=10)
    assert ended.value.rcvd is not None
    return ended.value.rcvd.code


@pytest.mark.parametrize(
    ("method", "path"),
    [
        ("POST", "/stop"),
        ("GET", "/rules"),
        ("GET", "/rules/sets"),
        ("POST", "/rules/check"),
        ("POST", "/rules/apply"),
    ],
)
def test_a_request_without_the_token_or_from_another_page_is_refused(
    page_and_publisher: tuple[LivePage, Publisher], method: str, path: str
) -> None:
    page, publisher = page_and_publisher
    for token in (None, "wrong"):
        assert page.request(method, path, {"stop": True}, token=token)[0] == 401
    assert page.request(method, path, {"stop": True}, Origin="http://elsewhere.example")[0] == 403
    assert page.request(method, path, {"stop": True}, Host="elsewhere.example:8620")[0] == 403
    time.sleep(0.2)
    assert publisher.requests == 0


@pytest.mark.parametrize("body", [b"no json", [], {}, {"stop": "yes"}, {"stop": 1}])
def test_a_stop_that_is_none_is_refused(page_and_publisher: tuple[LivePage, Publisher], body: object) -> None:
    page, publisher = page_and_publisher
    assert page.request("POST", "/stop", body)[0] == 400
    assert publisher.requests == 0


def test_a_request_that_is_too_long_is_refused(page: LivePage) -> None:
    assert page.request("POST", "/rules/check", {"text": "x" * MAX_BODY})[0] == 413


def test_the_static_files_say_that_nothing_else_may_be_loaded(page: LivePage) -> None:
    for path in ("/", "/static/app.js", "/static/page.css", "/static/missing.js"):
        _, headers, _ = page.request("GET", path, token=None)
        assert "default-src 'none'" in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"
    assert page.request("GET", "/static/../node.py", token=None)[0] == 404


def test_a_stream_needs_the_token_and_the_own_origin(page: LivePage) -> None:
    with stream(page, "wrong") as wrong, stream(page, origin="http://elsewhere.example") as foreign:
        assert end_of(wrong) == WRONG_TOKEN and end_of(foreign) == WRONG_ORIGIN
    with connect(f"ws://127.0.0.1:{page.door.port}/stream", proxy=None) as silent:
        silent.send(b"\x00")
        assert end_of(silent) == WRONG_TOKEN


def test_a_viewer_that_draws_nothing_gets_one_message_and_delays_no_other(page: LivePage) -> None:
    with stream(page) as slow, stream(page) as quick:
        times = []
        for _ in range(8):
            times.append(state_of(quick.recv(timeout=5))["now"])
            quick.send("drawn")
        assert times == sorted(times) and times[-1] - times[0] < 4.0
        first = state_of(slow.recv(timeout=5))
        with pytest.raises(TimeoutError):
            slow.recv(timeout=0.5)
        slow.send("drawn")
        newest = state_of(slow.recv(timeout=5))
        assert newest["now"] > times[-1] > first["now"]  # not the one after the first, but the newest
        samples = [sample[0] for sample in newest["samples"]]
        assert (
            samples == sorted(samples) and samples[0] > first["samples"][-1][0]
        )  # and the timeline has no gap


def test_pictures_are_received_only_with_a_viewer(page: LivePage) -> None:
    with stream(page) as viewer:
        assert until(lambda: "picture" in _next(viewer), patience_s=5)
    time.sleep(0.5)
    with stream(page) as another:
        assert "picture" not in _next(another)  # none was kept while nobody looked


def _next(viewer: ClientConnection) -> dict[str, Any]:
    state = state_of(viewer.recv(timeout=5))
    viewer.send("drawn")
    return state


def test_keeping_the_last_minutes_needs_the_token_and_something_to_keep(
    page: LivePage, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for token in (None, "wrong"):
        assert page.request("POST", "/keep", {}, token=token)[0] == 401
    assert page.request("GET", "/keep")[0] == 405
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for desk, why in (
        (KeepDesk(ring="a drive", recorded="/drive.mcap"), "the whole drive is recorded in /drive.mcap"),
        (KeepDesk(ring=None, recorded=None), "ring.max_mb of drive.yaml is 0"),
        (KeepDesk(ring="a drive", recorded=None), "a drive: holds nothing to keep yet"),
    ):
        with pytest.raises(InputError, match=why):
            desk.keep()
    assert not list(tmp_path.rglob("*.mcap"))


def test_the_button_keeps_the_ring_of_its_own_drive(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    for name in ("mine", "newer"):
        folder = tmp_path / "trepid" / "ring" / name
        folder.mkdir(parents=True)
        with Recording(folder / "000001.mcap", {}, {"what": name}) as part:
            part.add(DECISION.key, to_cdr(decision(10.0)), at_s=10.0)
    path = KeepDesk(ring="mine", recorded=None).keep()
    assert read_recording(path, DECISION.key).notes["what"] == "mine"


def test_the_number_of_viewers_has_a_limit(page: LivePage) -> None:
    with ExitStack() as viewers:
        for _ in range(MAX_VIEWERS):
            viewers.enter_context(stream(page)).recv(timeout=5)
        with stream(page) as another:
            assert end_of(another) == TOO_MANY
    assert until(lambda: _is_served(page), patience_s=5)


def _is_served(page: LivePage) -> bool:
    with stream(page) as viewer:
        try:
            return bool(viewer.recv(timeout=5))
        except ConnectionClosed:
            return False


def test_an_edit_of_a_file_that_has_changed_meanwhile_is_refused(page: LivePage) -> None:
    status, _, content = page.request("GET", "/rules")
    shown = json.loads(content)
    assert status == 200 and shown["sha256"] == hashlib.sha256(shown["text"].encode()).hexdigest()
    body = {"text": shown["text"], "sha256": "of another text"}
    status, _, content = page.request("POST", "/rules/apply", body)
    assert status == 409 and "has changed since the edit began" in json.loads(content)["error"]
    page.rules.unlink()
    try:
        status, _, content = page.request("GET", "/rules")
        assert status == 422 and f"{page.rules}: cannot be read" in json.loads(content)["error"]
    finally:
        page.rules.write_text(shown["text"], encoding="utf-8")


def test_rules_of_another_place_than_the_folder_of_the_car_are_not_replaced(tmp_path: Path) -> None:
    car, other = tmp_path / "car", tmp_path / "other.yaml"
    car.mkdir()
    try:
        use_car(car)
        desk = RuleDesk(other, other)
        assert desk.fixed_reason.endswith(f"copy it to {car / 'fear.yaml'}, and drive again")
        with pytest.raises(InputError, match="not in the folder of the car"):
            desk.apply("", "")
    finally:
        use_car(None)


@pytest.mark.parametrize("of_a_car", [False, True])
def test_applied_rules_of_the_installation_become_a_new_file_of_the_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, of_a_car: bool
) -> None:
    shipped, taken = CONFIG_DIR / "fear.yaml", tmp_path / "fear.yaml"
    monkeypatch.chdir(tmp_path)
    before = shipped.read_text(encoding="utf-8")
    try:
        use_car(tmp_path if of_a_car else None)
        assert place_of_edit(shipped) == taken
        desk = RuleDesk(shipped, place_of_edit(shipped))
        edited = f"# edited\n{before}"
        applied = desk.apply(edited, desk.show()["sha256"])
        assert (applied["ok"], applied["path"]) == (True, str(taken))
        assert (taken.read_text(encoding="utf-8"), shipped.read_text(encoding="utf-8")) == (edited, before)
        assert desk.show()["path"] == str(taken)
        again = desk.apply(f"{edited}# twice\n", applied["sha256"])
        assert again["path"] == str(taken) and taken.read_text(encoding="utf-8").endswith("# twice\n")
        assert (
            place_of_edit(shipped) == tmp_path / "fear-2.yaml"
        )  # of another drive, which overwrites nothing
    finally:
        use_car(None)


def test_a_file_that_appeared_at_the_place_of_an_edit_is_not_overwritten(tmp_path: Path) -> None:
    shipped, place = CONFIG_DIR / "fear.yaml", tmp_path / "fear.yaml"
    desk = RuleDesk(shipped, place)
    shown = desk.show()
    place.write_text("text of another program", encoding="utf-8")
    with pytest.raises(Conflict, match="has been written by another program"):
        desk.apply(shown["text"], shown["sha256"])
    assert place.read_text(encoding="utf-8") == "text of another program"
