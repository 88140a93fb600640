"""The times of the live page as a person meets them, against a program and a server of the test's making."""

import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lab.bench.live import answers
from trepid.config import InputError
from trepid.processes.endpoint import listening

TOKEN = "a-token"
DELAY_S = 0.3


def program(*, ended: bool = False) -> Any:
    return SimpleNamespace(
        popen=SimpleNamespace(poll=lambda: 1 if ended else None), errors=lambda: "no such scenario"
    )


class Rules(BaseHTTPRequestHandler):
    """Answers like a page whose check finds what the server says."""

    def do_GET(self) -> None:
        self._answer('{"text": "the rules"}')

    def do_POST(self) -> None:
        self.rfile.read(int(self.headers["content-length"]))
        known = self.headers["authorization"] == f"Bearer {TOKEN}"
        self._answer('{"ok": true}' if known else '{"ok": false, "lines": ["wrong token"]}')

    def _answer(self, text: str) -> None:
        self.send_response(200)
        self.send_header("content-length", str(len(text)))
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_: object) -> None:
        """Print nothing."""


def test_the_address_is_that_of_the_printed_line(tmp_path: Path) -> None:
    errors = tmp_path / "stderr"
    errors.write_text("trepid drive: live page: http://127.0.0.1:8620/#abc-_9\n")
    url, printed_s = answers._read_address(program(), errors)
    assert url == "http://127.0.0.1:8620/#abc-_9" and printed_s <= time.monotonic()


def test_a_drive_that_ends_without_an_address_says_why(tmp_path: Path) -> None:
    (tmp_path / "stderr").write_text("no such scenario\n")
    with pytest.raises(InputError, match="no address: no such scenario"):
        answers._read_address(program(ended=True), tmp_path / "stderr")


def test_an_address_that_refuses_at_first_counts_from_the_printed_line() -> None:
    with listening("127.0.0.1", 0) as probe:
        port = probe.getsockname()[1]
    served: list[ThreadingHTTPServer] = []

    def serve() -> None:
        served.append(ThreadingHTTPServer(("127.0.0.1", port), Rules))
        served[0].serve_forever(poll_interval=0.01)

    late = threading.Timer(DELAY_S, serve)
    printed_s = time.monotonic()
    late.start()
    try:
        assert answers._until_answer(f"http://127.0.0.1:{port}/#{TOKEN}", printed_s) >= DELAY_S
    finally:
        served[0].shutdown()
        served[0].server_close()
        late.join()


def test_a_check_needs_the_token_and_rules_that_pass() -> None:
    with ThreadingHTTPServer(("127.0.0.1", 0), Rules) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/"
        assert answers._check(f"{url}#{TOKEN}") > 0.0
        with pytest.raises(InputError, match="wrong token"):
            answers._check(f"{url}#wrong")
        server.shutdown()


def test_each_load_has_a_row_with_every_column(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(answers, "LOADS", (0, 1))
    monkeypatch.setattr(answers, "measure_answers", lambda: {"answer after the address is printed [s]": 0.1})
    assert list(answers.bench_page_answers()["drives"]) == ["load 0", "load 1"]
