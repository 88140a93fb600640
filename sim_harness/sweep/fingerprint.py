"""What a run depends on besides its case: our code and configuration, and the libraries that calculate."""

import hashlib
import importlib.metadata
import platform
from functools import cache

from trepid.config import CONFIG_DIR, ROOT
from trepid.packages import PACKAGES

LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "scikit-fuzzy")
_DIGITS = 16


@cache
def fingerprint() -> str:
    """A hash that changes with every file of code and configuration, and with every version that calculates.

    Read once a process: what a process has loaded does not change with the files.
    """
    digest = hashlib.sha256(f"{platform.machine()} {platform.python_version()}".encode())
    for library in LIBRARIES:
        digest.update(f"\0{library}=={importlib.metadata.version(library)}".encode())
    files = [path for package in PACKAGES for path in (ROOT / package).rglob("*.py")]
    files += [path for path in CONFIG_DIR.rglob("*") if path.suffix in (".yaml", ".yml")]
    files += (ROOT / "perception" / "weights").rglob("*")
    for path in sorted(path for path in files if path.is_file()):
        digest.update(f"\0{path.relative_to(ROOT).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:_DIGITS]
