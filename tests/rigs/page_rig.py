"""Commands of a documentation page, run in a folder like a checkout."""

import os
import re
import subprocess
import sys
from pathlib import Path

from trepid.config import ROOT


def console_blocks(page: str) -> list[list[str]]:
    """The commands of each console block of the page ``docs/page``, in their order."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return [block.strip().splitlines() for block in re.findall(r"```console\n(.*?)```", text, re.DOTALL)]


def checkout_like(folder: Path) -> Path:
    """Give ``folder`` the examples of the checkout and a `trepid` for :func:`run`."""
    (folder / "examples").symlink_to(ROOT / "examples")
    shim = folder / "bin" / "trepid"
    shim.parent.mkdir()
    shim.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec "{sys.executable}" -m trepid "$@"\n')
    shim.chmod(0o755)
    return folder


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run one command of a page in a folder of :func:`checkout_like`."""
    return subprocess.run(
        ["/bin/sh", "-c", command],
        cwd=folder,
        env={**os.environ, "PATH": f"{folder / 'bin'}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=150,
        check=False,
    )
