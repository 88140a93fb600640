"""The documentation site: it builds without a broken link, holds every page, and its search finds answers."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from browser_rig import chromium
from process_rig import until

from trepid.config import ROOT

pytest.importorskip("mkdocs")
pytest.importorskip("selenium")
pytestmark = pytest.mark.long
PATIENCE_S = 30.0
SHOWN = 5  # results that a reader sees without scrolling


class Quiet(SimpleHTTPRequestHandler):
    """Files of a folder, without a line for each request."""

    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(place)]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, "NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return place


@pytest.fixture(scope="module")
def browser(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with chromium(tmp_path_factory.mktemp("chromium")) as driver:
        driver.get(f"http://127.0.0.1:{server.server_port}/index.html")
        yield driver
    server.shutdown()


def results(browser: Any, words: str) -> list[str]:
    """The pages that the search of the site lists for these words, best first."""
    browser.refresh()  # without the results of another search
    browser.execute_script(
        """document.getElementById('__search').checked = true;
           const box = document.querySelector('.md-search__input');
           box.focus(); box.value = arguments[0];
           box.dispatchEvent(new Event('focus'));
           box.dispatchEvent(new KeyboardEvent('keyup', {bubbles: true}));""",
        words,
    )
    found = """return [...document.querySelectorAll('.md-search-result__list > li')]
        .map(item => item.querySelector('a').getAttribute('href').replace(/.*\\//, '').replace(/[?#].*/, ''))"""
    shown = "return document.querySelector('.md-search-result__meta').textContent"
    assert until(lambda: "matching" in browser.execute_script(shown), patience_s=PATIENCE_S)
    return [str(page) for page in browser.execute_script(found)]


@pytest.mark.parametrize(
    ("words", "page"),
    [
        ("cruise speed", "questions.html"),
        ("reverse the servo", "questions.html"),
        ("where are my recordings", "questions.html"),
        ("Raspberry Pi", "raspberry_pi.html"),
        ("why did the car slow down", "questions.html"),
        ("calibrate the camera", "calibration.html"),
        ("exit code", "compatibility.html"),
        ("train my own network", "train-your-own.html"),
        ("wheelbase_m", "files.html"),
        ("open_recording", "python_cockpit.html"),
    ],
)
def test_the_search_shows_the_page_of_an_answer(browser: Any, words: str, page: str) -> None:
    assert page in results(browser, words)[:SHOWN]
