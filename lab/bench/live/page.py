"""The live page: what it costs a drive, and how soon it shows what the camera sees.

Drives of the circuit in turns: without a viewer, and with one that acknowledges every message at once, a thread of
this process without a screen. Then one with a real browser, which also takes processor time to draw.
"""

import json
import os
import shutil
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from lab.bench.live.program import DriveProgram
from trepid.config import InputError

DRIVE_S = 30.0
ROUNDS = 3
SETTLE_S = 8.0  # the browser opens the page when the processes have started
LOOK_S = 15.0
WINDOW = (1440, 1100)
ALONE, VIEWED = "no viewer", "a viewer"
SHARE = "share of a core of the page [%]"
Row = dict[str, Any]


def bench_page() -> Row:
    """Share of a core of the page, frame to command with and without a viewer, capture to screen in a browser."""
    arms: dict[str, list[Row]] = {ALONE: [], VIEWED: []}
    for _ in range(ROUNDS):
        for arm, rows in arms.items():
            rows.append(drive_with_page(viewed=arm == VIEWED))
    return {**compare_arms(arms), "one drive with a browser": {"Chromium": browse()}}


def compare_arms(arms: Mapping[str, Sequence[Row]]) -> Row:
    """A row of medians for each arm, from the rows of its drives, and the ratio of drives next to each other."""
    p99_ms = {
        arm: [row["latency_ms"]["frame_to_command"]["p99"] for row in rows] for arm, rows in arms.items()
    }
    ratios = [viewed / alone for alone, viewed in zip(p99_ms[ALONE], p99_ms[VIEWED], strict=True)]
    return {
        "drives in turns": {
            arm: {
                SHARE: statistics.median(row["processes"]["page"]["cpu_percent"] for row in rows),
                "frame to command, p99 [ms]": statistics.median(p99_ms[arm]),
            }
            for arm, rows in arms.items()
        },
        "p99 with a viewer, relative to without": round(statistics.median(ratios), 3),
    }


def drive_with_page(*, viewed: bool) -> Row:
    """The row of one drive. Raises InputError when it does not begin."""
    with _drive() as program:
        url = page_of(program)
        if not viewed:
            return program.row()
        with looking(url):
            return program.row()


def browse(picture: Path | None = None) -> Row:
    """What a browser sees of one drive; ``picture``: file for its screenshot. Raises InputError without one."""
    with _drive() as program, browser() as chromium:
        url = page_of(program)
        time.sleep(SETTLE_S)
        chromium.get(url)
        time.sleep(LOOK_S)
        delays = sorted(chromium.execute_script("return trepid.glass"))
        first_ms = chromium.execute_script("return trepid.firstPicture")
        errors = [entry for entry in chromium.get_log("browser") if entry["level"] == "SEVERE"]
        sizes = "return performance.getEntriesByType('resource').reduce((sum, one) => sum + one.decodedBodySize, 0)"
        size = chromium.execute_script(sizes)
        if picture is not None:
            chromium.save_screenshot(str(picture))
        row = program.row()
    if not delays:
        raise InputError("the browser showed no picture")
    return {
        "pictures": len(delays),
        "capture to screen, median [ms]": round(statistics.median(delays), 1),
        "capture to screen, p95 [ms]": round(delays[int(0.95 * (len(delays) - 1))], 1),
        "first picture after opening [ms]": None if first_ms is None else round(first_ms),
        "errors in the console": len(errors),
        "loaded [kB]": round(size / 1000),
        SHARE: row["processes"]["page"]["cpu_percent"],
    }


@contextmanager
def _drive() -> Iterator[DriveProgram]:
    with tempfile.TemporaryDirectory(prefix="trepid-page-") as folder:
        words = ["--scenario", "circuit", "--set", f"duration_s={DRIVE_S}", "--set", "expect={}"]
        program = DriveProgram(Path(folder), words)
        try:
            yield program
        finally:
            program.close()


def page_of(program: DriveProgram) -> str:
    """The address of the page of a drive. Raises InputError without one."""
    if program.running.page is None:
        raise InputError("the drive serves no page")
    return program.running.page


@contextmanager
def looking(url: str) -> Iterator[None]:
    """A viewer at ``url`` that acknowledges every message, until the page ends or the body does."""
    ended = threading.Event()
    viewer = threading.Thread(target=_look, args=(url, ended))
    viewer.start()
    try:
        yield
    finally:
        ended.set()
        viewer.join()


def _look(url: str, ended: threading.Event) -> None:
    address, _, token = url.partition("#")
    while not ended.wait(0.2):  # the page may not be there yet
        try:
            with connect(address.replace("http", "ws", 1) + "stream", proxy=None) as stream:
                stream.send(json.dumps({"token": token}))
                while not ended.is_set():
                    stream.recv(timeout=5.0)
                    stream.send("drawn")
        except (OSError, TimeoutError, ConnectionClosed):
            continue


@contextmanager
def browser() -> Iterator[Any]:
    """Chromium without a window. Raises InputError where it is missing."""
    program, driver = shutil.which("chromium") or shutil.which("google-chrome"), shutil.which("chromedriver")
    try:
        from selenium import webdriver
    except ImportError as error:
        raise InputError("the browser needs the extra `test`: pip install 'trepid[test]'") from error
    if program is None or driver is None:
        raise InputError("no Chromium with its driver here (Debian: chromium, chromium-driver)")
    with tempfile.TemporaryDirectory(prefix="trepid-browser-", ignore_cleanup_errors=True) as profile:
        options = webdriver.ChromeOptions()
        options.binary_location = program
        for flag in (
            *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"),
            *("--disable-background-networking", "--disable-component-update"),
            *(f"--window-size={WINDOW[0]},{WINDOW[1]}", f"--user-data-dir={profile}"),
        ):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        environment = {**os.environ, "no_proxy": "localhost,127.0.0.1"}
        service = webdriver.ChromeService(executable_path=driver, env=environment)
        chromium = webdriver.Chrome(options=options, service=service)
        try:
            yield chromium
        finally:
            chromium.quit()
