"""The last minutes of every drive on disk: short recordings one after the other, the oldest deleted beyond a size.

Each drive has a folder of its own below ``$XDG_STATE_HOME/trepid/ring`` (default: ``~/.local/state/trepid/ring``),
which the launcher names; a recorder that is started again goes on in it.
A part is a whole MCAP file of ``part_s``; the one being written is readable up to its last half second, also after
a crash. :func:`keep_parts` joins the parts of a drive into one recording in ``…/trepid/kept``, which nothing
deletes.
"""

import itertools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Collection, Mapping
from contextlib import ExitStack, suppress
from datetime import datetime
from pathlib import Path

from trepid.bus import Tap
from trepid.clock import seconds
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.messages import Diagnostic
from trepid.processes.drive_settings import DriveSettings, RingSettings
from trepid.processes.register import choose, running
from trepid.recording.notes import RULES_FROM_S
from trepid.recording.writer import BEGAN, Recording, attach_adopted, remove
from trepid.topics import DIAGNOSTICS
from trepid.wire import WireError, from_cdr

MB = 1_000_000
STAMP = "%Y-%m-%d-%H-%M-%S"
KEPT_NICE = 19  # of the process that joins parts during a drive


def ring_settings() -> RingSettings:
    """``ring`` of ``drive.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "drive.yaml", DriveSettings).ring


def state_folder(name: str) -> Path:
    """Folder ``name`` of the user's state. Raises InputError without a home folder."""
    root = os.environ.get("XDG_STATE_HOME", "")
    try:
        top = Path(root) if Path(root).is_absolute() else Path.home() / ".local" / "state"
    except RuntimeError as error:
        raise InputError("no folder for recordings: there is no home folder; set XDG_STATE_HOME") from error
    return top / "trepid" / name


class Ring:
    """The parts of one drive, being written from a tap of the bus."""

    def __init__(
        self,
        tap: Tap,
        name: str,
        settings: RingSettings,
        files: Mapping[str, bytes],
        notes: Mapping[str, str],
    ) -> None:
        """Make the folder ``name``. Raises InputError."""
        self._tap, self._settings = tap, settings
        self._files, self.notes = dict(files), dict(notes)
        self.folder = state_folder("ring") / name
        self._make_folder()
        self._part: Recording | None = None
        self._count = max((int(part.stem) for part in self.folder.glob("*.mcap")), default=0)
        self._until_s = -1.0

    def _make_folder(self) -> None:
        """Also again: while it is empty, another drive deletes it."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{self.folder}: cannot be made: {error.strerror}") from error

    def write(self) -> None:
        """Write all messages since the last call. Raises InputError when the disk refuses them."""
        for key, data, at_s in self._tap.drain():
            if self._part is None or at_s >= self._until_s:
                self._next(at_s)
            if self._part is not None:
                self._part.add(key, data, at_s=at_s)
            if key == DIAGNOSTICS.key and RULES_FROM_S.encode() in data:
                self._attach_rules(data)

    def began_ns(self, stamp_ns: int) -> None:
        """Note the start of the drive in this part and the next ones."""
        self.notes[BEGAN] = str(stamp_ns)
        if self._part is not None:
            self._part.began_ns(stamp_ns)

    def close(self) -> None:
        """End the part being written."""
        if self._part is not None:
            part, self._part = self._part, None
            part.__exit__()

    def _attach_rules(self, heartbeat: bytes) -> None:
        """Attach the rules that ``heartbeat`` reports as adopted to the next parts, which may outlive it."""
        with suppress(WireError):  # malformed on the bus
            attach_adopted(self._files, from_cdr(heartbeat, Diagnostic))

    def _next(self, at_s: float) -> None:
        self.close()
        prune(self.folder.parent, MB * self._settings.max_mb, own=self.folder)
        self._make_folder()
        self._count += 1
        self._until_s = at_s + self._settings.part_s
        self._part = Recording(self.folder / f"{self._count:06d}.mcap", self._files, self.notes)


def prune(root: Path, most_bytes: float, *, own: Path) -> None:
    """Delete the oldest parts of all drives below ``root`` beyond ``most_bytes``, and empty folders but ``own``."""
    with suppress(OSError):
        parts = _by_age(root, alive={own.name, *(drive.ring for drive in running())})
        excess = sum(path.stat().st_size for path in parts) - most_bytes
        for path in parts[:-1]:
            if excess <= 0:
                break
            excess -= path.stat().st_size
            path.unlink()
        for folder in root.iterdir():
            with suppress(OSError):  # not empty
                if folder != own:
                    folder.rmdir()


def _by_age(root: Path, *, alive: Collection[str | None]) -> list[Path]:
    """The parts below ``root``, the oldest first. Raises OSError.

    Those of drives that have ended, by the time of their files; then those of the drives ``alive``, by the number
    of newer parts of the same drive: after a wall clock was set back, the newest part would be the oldest file.
    """
    ranked = []
    for folder in root.iterdir():
        parts = sorted(folder.glob("*.mcap"))
        for place, part in enumerate(parts):
            age = place - len(parts) if folder.name in alive else part.stat().st_mtime
            ranked.append((folder.name in alive, age, part))
    return [part for *_, part in sorted(ranked)]


def ring_name(*, now_s: float) -> str:
    """The name of the ring of a drive whose launcher is this process."""
    return f"{datetime.fromtimestamp(now_s).strftime(STAMP)}-{os.getpid()}"


def ring_of(endpoint: str | None = None) -> Path:
    """Folder of the parts of the running drive, of that at ``endpoint``, or of the last one when none runs.

    Raises InputError where several run, and where the running drive has no ring.
    """
    drives = running()
    if not drives and endpoint is None:
        return newest()
    drive = choose(endpoint, [drive for drive in drives if drive.ring or endpoint is not None] or drives)
    if drive.ring is None:
        raise InputError(
            f"{drive.what} (pid {drive.pid}) writes no last minutes: it is a replay, its whole drive is recorded, "
            "or ring.max_mb of drive.yaml is 0"
        )
    return state_folder("ring") / drive.ring


def newest() -> Path:
    """Folder of the parts of the newest drive. Raises InputError without one."""
    root = state_folder("ring")
    folders = {path.parent for path in root.glob("*/*.mcap")} if root.is_dir() else set()
    if not folders:
        raise InputError(f"{root}: holds no drive to keep; `trepid drive` writes there")
    return max(folders, key=lambda folder: max(part.stat().st_mtime for part in folder.glob("*.mcap")))


def keep_parts(folder: Path, out: Path) -> None:
    """Join the parts in ``folder`` into the new recording ``out``, whole or not at all. Raises InputError."""
    from trepid.recording.foreign import in_order  # only the process that joins reads recordings
    from trepid.recording.reader import read_recording

    # a part that has just been begun is still empty
    parts = [part for part in sorted(folder.glob("*.mcap")) if part.stat().st_size]
    if not parts:
        raise InputError(f"{folder}: holds no recording")
    held = [read_recording(part) for part in parts]
    notes = {name: text for one in held for name, text in one.notes.items()}
    recording = Recording(out, held[0].files, notes)
    with ExitStack() as undo:
        undo.callback(remove, out)
        with recording:
            for part in parts:
                for log_ns, key, data in in_order(part):
                    recording.add(key, data, at_s=seconds(log_ns))
        undo.pop_all()


def join_secured_parts(safe: Path, out: Path) -> None:
    """As :func:`keep_parts` for secured parts, which are deleted, also where the recording fails."""
    try:
        keep_parts(safe, out)
    finally:
        shutil.rmtree(safe, ignore_errors=True)


def secure_parts(folder: Path) -> Path:
    """A new folder beside the kept recordings with the present parts of ``folder``, which no ring deletes.

    Raises InputError, and then leaves nothing.
    """
    if not any(folder.glob("*.mcap")):
        raise InputError(f"{folder}: holds nothing to keep yet")
    top = state_folder("kept")
    with ExitStack() as undo:
        try:
            top.mkdir(parents=True, exist_ok=True)
            safe = Path(tempfile.mkdtemp(prefix="parts-", dir=top))
            undo.callback(shutil.rmtree, safe, ignore_errors=True)
            for part in sorted(folder.glob("*.mcap")):
                try:
                    os.link(part, safe / part.name)
                except FileNotFoundError:
                    continue  # the ring has just deleted it
                except OSError:  # a file system without hard links
                    shutil.copy2(part, safe / part.name)
        except OSError as error:
            raise InputError(f"{top}: cannot be written: {error.strerror}") from error
        undo.pop_all()
    return safe


def free_path(path: Path) -> Path:
    """``path``, or the first of ``path-2``, ``path-3``, … that does not exist."""
    names = (path.with_stem(f"{path.stem}-{number}") for number in itertools.count(2))
    return next(name for name in itertools.chain([path], names) if not name.exists())


def kept_name(reason: str, *, now_s: float) -> Path:
    """A free name for a kept recording."""
    stamp = datetime.fromtimestamp(now_s).strftime(STAMP)
    return free_path(state_folder("kept") / f"{stamp}-{reason}.mcap")


def keep_apart(folder: Path, out: Path) -> None:
    """Secure the parts in ``folder`` now, and let another process of low priority join them. Raises InputError."""
    subprocess.Popen(_joining(folder, out), cwd=ROOT, stdin=subprocess.DEVNULL, start_new_session=True)


def keep_in_other_process(folder: Path, out: Path) -> None:
    """As :func:`keep_apart`, and wait for its end. Raises InputError."""
    done = subprocess.run(
        _joining(folder, out),
        cwd=ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        start_new_session=True,
        check=False,
    )
    if done.returncode != 0:
        raise InputError(done.stderr.strip() or f"{out}: the parts could not be joined")


def _joining(folder: Path, out: Path) -> list[str]:
    """The command that joins the present parts in ``folder``, which are secured now. Raises InputError."""
    return [sys.executable, "-m", "trepid.recording.ring", str(secure_parts(folder)), str(out)]


def kept_size() -> int:
    """Bytes of the kept recordings."""
    with suppress(OSError):
        return sum(path.stat().st_size for path in state_folder("kept").rglob("*.mcap"))
    return 0


def main(folder: str, out: str) -> int:
    """Join the parts in ``folder``, which is deleted afterwards."""
    os.nice(KEPT_NICE)
    try:
        join_secured_parts(Path(folder), Path(out))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
