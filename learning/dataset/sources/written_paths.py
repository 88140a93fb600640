"""Paths of images as logs write them: of another machine, of Windows, as URLs, in another spelling."""

import re
import unicodedata
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

FILE_URL = re.compile(r"^file:/+")


class ImageFolder:
    """A folder with images, whose files are found by the paths that a log has of them."""

    def __init__(self, folder: Path) -> None:
        """``folder``: of the log, or of its images."""
        self._folder = folder
        self._names: dict[Path, dict[str, str]] = {}  # of a folder: its names by their folded form

    def find(self, written: str) -> str:
        """The image ``written`` in a log, relative to the folder where it lies below it.

        The whole path counts first, then its last parts, the most of them first; then the same with %20 and
        the like decoded as in a URL; then without regard to upper and lower case and to composed letters,
        where only one file fits. An image that is not found is returned as it is written, of an absolute path
        the last two parts. Raises ValueError for an empty path.
        """
        given = FILE_URL.sub("/", written)
        forms = [_ends(form) for form in dict.fromkeys((given, unquote(given)))]
        if not forms[0]:
            raise ValueError("no image")
        places = [place for form in forms for place in form]
        found = next((place for place in places if (self._folder / place).is_file()), None)
        found = found or next(filter(None, map(self._other_spelling, places)), None)
        return found or ("/".join(_parts(given)[-2:]) if _is_absolute(given) else forms[0][0])

    def _other_spelling(self, place: str) -> str | None:
        """The only file whose name is ``place`` but for case and composed letters."""
        here, found = self._folder, []
        for part in _parts(place):
            if here not in self._names:
                self._names[here] = _folded_names(here)
            name = part if part == ".." else self._names[here].get(_fold(part), "")
            if not name:
                return None
            here /= name
            found.append(name)
        return "/".join(found) if here.is_file() else None


def _is_absolute(path: str) -> bool:
    return bool(PureWindowsPath(path).anchor)


def _parts(path: str) -> tuple[str, ...]:
    """The parts of a path of Linux or Windows, without root and drive."""
    windows = PureWindowsPath(path)
    return windows.parts[1:] if windows.anchor else windows.parts


def _ends(path: str) -> list[str]:
    """Where ``path`` may lead: its ends below the folder, an absolute one before its name alone."""
    parts = _parts(path)
    ends = ["/".join(parts[first:]) for first in range(len(parts))]
    return [*ends[:-1], path, *ends[-1:]] if ends and _is_absolute(path) else ends


def _fold(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()


def _folded_names(folder: Path) -> dict[str, str]:
    """The names in ``folder`` by their folded form; without those that two names share."""
    found: dict[str, str] = {}
    for path in folder.iterdir() if folder.is_dir() else ():
        folded = _fold(path.name)
        found[folded] = "" if folded in found else path.name
    return found
