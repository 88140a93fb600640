"""Checkpoints that survive a kill and name damage: the last one and the one before, each with its hash."""

import hashlib
import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from trepid.config import InputError

DIGEST_BYTES = hashlib.sha256().digest_size


class Checkpoints:
    """``path`` and, beside it, the checkpoint before.

    A file is the SHA-256 of its rest, and what ``torch.save`` writes. It is written beside ``path`` and renamed, so
    that a kill leaves a whole one.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.before = path, path.with_suffix(".before")

    def save(self, content: dict[str, Any]) -> None:
        """Write ``content``; the last checkpoint becomes the one before."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        stream = io.BytesIO()
        torch.save(content, stream)
        fresh = self.path.with_suffix(".new")
        with fresh.open("wb") as file:
            file.write(hashlib.sha256(stream.getbuffer()).digest())
            file.write(stream.getbuffer())
        if self.path.exists():
            self.path.replace(self.before)
        fresh.replace(self.path)

    def load(self, report: Callable[[str], None]) -> dict[str, Any] | None:
        """The last checkpoint, or the one before where the last is damaged; None without any.

        Raises InputError when all are damaged.
        """
        found = [path for path in (self.path, self.before) if path.is_file()]
        for path in found:
            content = _read(path)
            if content is not None:
                return content
            report(f"{path}: cut off or damaged: not used")
        if found:
            raise InputError(
                f"{found[0]}: cut off or damaged, and no other checkpoint; train without --resume"
            )
        return None

    def of(self, identity: str, report: Callable[[str], None]) -> dict[str, Any] | None:
        """:meth:`load`, of the training ``identity``; raises InputError for a checkpoint of another one."""
        saved = self.load(report)
        if saved is not None and saved["identity"] != identity:
            raise InputError(f"{self.path}: of another network, recipe or data set; train without --resume")
        return saved

    def exist(self) -> bool:
        """Whether there is one, whole or not."""
        return self.path.exists() or self.before.exists()


def _read(path: Path) -> dict[str, Any] | None:
    """The content of a whole file, on the CPU; None of a damaged one."""
    data = path.read_bytes()
    if hashlib.sha256(data[DIGEST_BYTES:]).digest() != data[:DIGEST_BYTES]:
        return None
    content: dict[str, Any] = torch.load(
        io.BytesIO(data[DIGEST_BYTES:]), map_location="cpu", weights_only=True
    )
    return content
