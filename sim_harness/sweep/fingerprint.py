"""What a run depends on besides its case: our code and configuration, and the libraries that calculate."""

import hashlib
import importlib.metadata
import platform
from functools import cache

from trepid.config import CONFIG_DIR, ROOT
from trepid.packages import PACKAGES

LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "scikit-fuzzy")
SUFFIXES = (".py", ".yaml", ".yml", ".onnx", ".json")
_DIGITS = 16


@cache
def fingerprint(*parts: str) -> str:
    """A hash that changes with every file of code and configuration, and with every version that calculates.

    ``parts`` are the files and folders of the repository that matter; without, all of our packages and config/.
    Read once a process: what a process has loaded does not change with the files.
    """
    digest = hashlib.sha256(f"{platform.machine()} {platform.python_version()}".encode())
    for library in LIBRARIES:
        digest.update(f"\0{library}=={importlib.metadata.version(library)}".encode())
    tops = [ROOT / part for part in parts or (*PACKAGES, CONFIG_DIR.name)]
    files = [path for top in tops for path in (top.rglob("*") if top.is_dir() else [top])]
    for path in sorted(path for path in files if path.suffix in SUFFIXES and path.is_file()):
        digest.update(f"\0{path.relative_to(ROOT).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:_DIGITS]
