"""The record button of the page: keeps the last minutes as one recording, as ``trepid record keep`` does."""

import time
from pathlib import Path

from trepid.config import InputError
from trepid.recording.ring import kept_by_another, kept_name, state_folder


class KeepDesk:
    """Keeps the last minutes of this drive, where it writes them."""

    def __init__(self, *, ring: str | None, recorded: str | None) -> None:
        """``ring``: name of the ring of this drive, None without one. ``recorded``: the file of the whole drive."""
        self._ring = ring
        self.why_not = ""
        """Why there is nothing to keep; "" where the last minutes are written."""
        if recorded is not None:
            self.why_not = f"the whole drive is recorded in {recorded}"
        elif ring is None:
            self.why_not = "the last minutes are not written: ring.max_mb of drive.yaml is 0"

    def keep(self) -> Path:
        """Keep the last minutes in a new file; another process of low priority joins the parts.

        Raises InputError.
        """
        if self.why_not or self._ring is None:
            raise InputError(self.why_not)
        path = kept_name("page", now_s=time.time())
        kept_by_another(state_folder("ring") / self._ring, path)
        return path
