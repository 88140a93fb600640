"""``trepid bench page-answers``: how soon the live page of a drive answers, on a quiet and on a loaded machine.

A person opens the address that the drive prints, sees the car, and checks an edit of the rules. The times are those
of this person: from the printed line to the first answer and to the first picture, and of one check.
"""

import json
import re
import tempfile
import time
from pathlib import Path
from typing import Any
from urllib.request import ProxyHandler, Request, build_opener

from websockets.sync.client import connect

from lab.bench.live.agreement import busy
from lab.bench.live.page import looking
from lab.bench.live.program import START_S, DriveProgram
from trepid.config import InputError

LOADS = (0, 8)
DRIVE_S = 20.0
PATIENCE_S = 60.0
ADDRESS = re.compile(r"https?://\S+#\S+")
JPEG = b"\xff\xd8\xff"
WORDS = ["--scenario", "circuit", "--set", f"duration_s={DRIVE_S}", "--set", "expect={}"]
OPENER = build_opener(ProxyHandler({}))  # the page is on this machine
Row = dict[str, Any]


def bench_page_answers() -> Row:
    """A row of times for each load. Raises InputError when a drive does not begin."""
    rows: dict[str, Row] = {}
    for load in LOADS:
        with busy(load):
            rows[f"load {load}"] = measure_answers()
    return {"drives": rows}


def measure_answers() -> Row:
    """The times of one drive."""
    with tempfile.TemporaryDirectory(prefix="trepid-page-") as folder:
        program = DriveProgram(Path(folder), WORDS)
        try:
            url, printed_s = _read_address(program, Path(folder) / "stderr")
            answer_s = _until_answer(url, printed_s)
            picture_s = _until_picture(url, printed_s)
            check_s = _check(url)
            with looking(url):
                row = program.row()
        finally:
            program.close()
    command_ms = row["latency_ms"]["frame_to_command"]
    return {
        "answer after the address is printed [s]": round(answer_s, 2),
        "first picture after it [s]": round(picture_s, 2),
        "check of the rules [s]": round(check_s, 2),
        "frame to command, p50 [ms]": command_ms["p50"],
        "frame to command, p99 [ms]": command_ms["p99"],
    }


def _read_address(program: DriveProgram, errors: Path) -> tuple[str, float]:
    """The address of the page, and when it was there. Raises InputError without one."""
    until_s = time.monotonic() + START_S
    while time.monotonic() < until_s and program.popen.poll() is None:
        found = ADDRESS.search(errors.read_text(errors="replace"))
        if found:
            return found[0].rstrip(".,;"), time.monotonic()
        time.sleep(0.005)
    raise InputError(f"the drive printed no address: {program.errors()}")


def _until_answer(url: str, printed_s: float) -> float:
    """Seconds from the printed line to the first answer."""
    while time.monotonic() - printed_s < PATIENCE_S:
        try:
            with OPENER.open(url.partition("#")[0], timeout=PATIENCE_S) as answer:
                answer.read()
            return time.monotonic() - printed_s
        except OSError:
            time.sleep(0.01)
    raise InputError(f"{url}: no answer within {PATIENCE_S:g} s")


def _until_picture(url: str, printed_s: float) -> float:
    """Seconds from the printed line to the first picture of a viewer that opens the page at once."""
    address, _, token = url.partition("#")
    with connect(address.replace("http", "ws", 1) + "stream", proxy=None) as stream:
        stream.send(json.dumps({"token": token}))
        while time.monotonic() - printed_s < PATIENCE_S:
            message = stream.recv(timeout=PATIENCE_S)
            if isinstance(message, bytes) and JPEG in message:
                return time.monotonic() - printed_s
            stream.send("drawn")
    raise InputError(f"{url}: no picture within {PATIENCE_S:g} s")


def _check(url: str) -> float:
    """Seconds for a check of the rules of the drive. Raises InputError where they are refused."""
    address, _, token = url.partition("#")
    bearer = {"Authorization": f"Bearer {token}"}
    with OPENER.open(Request(address + "rules", headers=bearer), timeout=PATIENCE_S) as answer:
        text = json.load(answer)["text"]
    body = json.dumps({"text": text}).encode()
    began_s = time.monotonic()
    with OPENER.open(Request(address + "rules/check", body, bearer), timeout=PATIENCE_S) as answer:
        found = json.load(answer)
    if not found["ok"]:
        raise InputError(f"the rules of the drive are refused: {found['lines']}")
    return time.monotonic() - began_s
