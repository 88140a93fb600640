"""The documented commands run from an installed wheel in an empty folder. Run by `make documented`.

The commands of the fenced blocks of a page run in their order, those of the help as one page. Each page has a
folder of its own: it is a test that runs alone. What a reader brings is in reader_rig, how a command differs from
the page in short_form_rig.
"""

import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from command_rig import TYPED, DocumentedCommand, outputs
from process_rig import until
from reader_rig import bring_files, prepare_files
from short_form_rig import BESIDE_A_DRIVE, begins, good_codes, is_tried, short_form
from wheel_rig import Installation, build_wheel, install_package

pytestmark = pytest.mark.wheel

PATIENCE_S = 600
HELP = "help"


def page_of(command: DocumentedCommand) -> str:
    return command.place.partition(":")[0] if ":" in command.place else HELP


def pages() -> dict[str, dict[str, DocumentedCommand]]:
    """Page -> its commands, by their words; an example of the help that is on a page is tried there."""
    found: dict[str, dict[str, DocumentedCommand]] = {}
    for one in filter(is_tried, TYPED):
        found.setdefault(page_of(one), {})[" ".join(one.words)] = one
    on_pages = {text for page, commands in found.items() if page != HELP for text in commands}
    found[HELP] = {text: one for text, one in found[HELP].items() if text not in on_pages}
    return found


PAGES = pages()


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Installation:
    """An installation, and in its empty folder what readers of the pages have."""
    place = tmp_path_factory.mktemp("pages")
    (place / "dist").mkdir()
    found = install_package(build_wheel(place / "dist")["wheel"], place)
    bring_files(found)
    prepare_files(found)
    return found


@pytest.fixture
def own(reader: Installation, tmp_path: Path) -> Iterator[Installation]:
    """The installation with copies of the folders, so that no page needs what another wrote."""
    found = reader._replace(work=tmp_path / "work", home=tmp_path / "home")
    shutil.copytree(reader.work, found.work)
    shutil.copytree(reader.home, found.home)
    yield found
    shutil.rmtree(tmp_path)


def remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


@pytest.mark.parametrize("page", PAGES)
def test_every_command_of_a_page_runs_and_writes_its_files(own: Installation, page: str) -> None:
    wrong = {}
    for text, command in PAGES[page].items():
        words = [re.sub(r"^~", str(own.home), word) for word in short_form(command)]
        written = [own.work / path for path in sorted(outputs(command))]
        if not {"--force", "--resume"} & set(words):
            for path in written:
                remove(path)
        started_s = time.monotonic()
        try:
            done = own.run(*words, timeout_s=PATIENCE_S)
        except subprocess.TimeoutExpired:
            wrong[text] = f"has not ended after {PATIENCE_S} s"
            continue
        why = "".join(done.stdout.splitlines()[:1]) if done.returncode == 1 else ""
        print(f"{time.monotonic() - started_s:.0f} s, exit code {done.returncode}: {' '.join(words)} {why}")
        missing = [path.name for path in written if done.returncode == 0 and not path.exists()]
        if done.returncode not in good_codes(command) or "Traceback" in done.stderr or missing:
            wrong[text] = (
                f"exit code {done.returncode}, {missing} missing: {done.stdout[-300:]}{done.stderr[-600:]}"
            )
    assert wrong == {}, "\n".join(f"{text}: {said}" for text, said in wrong.items())


@pytest.fixture
def running(reader: Installation) -> Iterator[subprocess.Popen[str]]:
    """A drive that has begun, until the test ends."""
    with subprocess.Popen(
        ["trepid", "drive", "--duration", "300"],
        cwd=reader.work,
        env=reader.variables,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as drive:
        try:
            assert until(lambda: reader.trepid("status").returncode == 0, patience_s=60.0)
            time.sleep(3.0)  # of driving, for the ring of the recorder
            yield drive
        finally:
            drive.terminate()


def test_every_command_beside_a_drive_runs(reader: Installation, running: subprocess.Popen[str]) -> None:
    commands = {" ".join(one.words[1:]): one for one in TYPED if begins(one, *BESIDE_A_DRIVE)}
    rows = {text: reader.trepid(*one.words[1:]) for text, one in commands.items()}
    wrong = {text: row.stdout + row.stderr for text, row in rows.items() if row.returncode}
    assert wrong == {} and running.poll() is None


def test_a_command_of_the_laboratory_is_refused_with_the_place_that_has_it(reader: Installation) -> None:
    done = reader.trepid("bench")
    assert done.returncode == 2 and "in a clone" in done.stderr and len(done.stderr.splitlines()) == 1
