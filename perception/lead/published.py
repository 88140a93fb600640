"""Detectors of real vehicles and people that come in a package of a public registry, by name.

``detector: NAME`` in ``config/lead.yaml`` uses one; ``trepid detector fetch NAME`` gets it once. Network and
licence are those of its publisher. Its bytes are compared with a SHA-256, so that no other file is ever run.
"""

import hashlib
import io
import os
import tarfile
from pathlib import Path
from typing import NamedTuple

from perception.lead.boxes import BoxSettings
from perception.lead.detection import Platt
from perception.net.published_files import data_file, download, store
from trepid.config import InputError


class PublishedDetector(NamedTuple):
    """A detector within a package."""

    package: str  # and its version
    url: str  # below the address of the registry
    licence: str
    member: str  # the file of the package ...
    start: int  # ... and the place of the detector in it [bytes]
    size: int
    sha256: str
    layout: BoxSettings  # how its output is read


REGISTRY = "https://registry.npmjs.org"
REGISTRY_VARIABLE = "npm_config_registry"  # as for npm
PUBLISHED = {
    "objectron": PublishedDetector(
        package="@mediapipe/objectron 0.4.1675468480 (npm)",
        url="@mediapipe/objectron/-/objectron-0.4.1675468480.tgz",
        licence="Apache-2.0",
        member="package/objectron_solution_packed_assets.data",
        start=184,
        size=9_987_728,
        sha256="d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
        layout=BoxSettings(
            layout="ssd",
            classes={"vehicle": (18, 23), "person": (4,), "bicycle": (1,), "animal": (6, 8, 20)},
            min_score=0.2,
            tile_share=0.5,
            calibration=Platt(bias=3.4, slope=4.0),
            calibrations={"animal": Platt(bias=5.5, slope=4.0)},
        ),
    ),
}
"""``objectron``: SSD-MobileNetV2 300x300, 24 classes of Open Images v4: of these Vehicle and Car, Person, Bicycle,
and Cattle, Cat and Dog count.

Its scores end at 0.6. The calibration makes 0.3 an even chance, 0.4 a probability of 0.84 and 0.5 of 0.97: by eye
on highway frames, with the margin that streets need. The scores of animals are lower: those of drawn dogs up to
13 m away begin at 0.14, with a median of 0.25; without an animal they stay below 0.17, on streets (CamVid) below
0.11. For them 0.2 is an even chance. The part around the horizon is searched again: a person 20 m away is 17 px
high.
"""


def file_of(name: str) -> Path:
    """Where the detector ``name`` is kept."""
    return data_file("detectors", f"{name}.tflite")


def fetched_detector(name: str) -> Path:
    """The file of the detector ``name``. Raises InputError where it was not fetched, or is another file."""
    path = file_of(name)
    if not path.is_file():
        raise InputError(f"detector {name}: not on this machine; `trepid detector fetch {name}` gets it")
    if hashlib.sha256(path.read_bytes()).hexdigest() != PUBLISHED[name].sha256:
        raise InputError(f"{path}: not the detector {name}; `trepid detector fetch {name}` gets it again")
    return path


def fetch(name: str) -> Path:
    """Get the detector ``name`` from its registry; its file. Raises InputError, and then leaves nothing behind."""
    published, path = PUBLISHED[name], file_of(name)
    address = f"{os.environ.get(REGISTRY_VARIABLE, REGISTRY).rstrip('/')}/{published.url}"
    packed = download(address)
    content = _unpack(packed, published, address)
    if hashlib.sha256(content).hexdigest() != published.sha256:
        raise InputError(f"{address}: the SHA-256 of its detector is not that of {name}")
    store(path, content)
    return path


def _unpack(packed: bytes, published: PublishedDetector, address: str) -> bytes:
    try:
        with tarfile.open(fileobj=io.BytesIO(packed)) as archive:
            member = archive.extractfile(published.member)
            content = b"" if member is None else member.read()
    except (tarfile.TarError, KeyError, EOFError, OSError) as error:
        raise InputError(f"{address}: no package with {published.member}") from error
    return content[published.start : published.start + published.size]
