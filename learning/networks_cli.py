"""``trepid networks``: segmentation networks for the estimator ``segments``."""

import hashlib
from pathlib import Path
from typing import Annotated

import typer

from perception.net.published_files import download, store
from perception.segments.network import Segmenter, SegmentNetwork
from perception.segments.settings import FOLDER, fetched_file, network_description
from trepid.config import InputError, default_names

ONNX = ".onnx"

app = typer.Typer(
    no_args_is_help=True, help="Segmentation networks of lane lines and drivable area, for real roads."
)


@app.command("list")
def list_networks() -> None:
    """Print the described networks: what they mark, their licence, and whether they are on this machine."""
    for name in default_names(FOLDER):
        about, path = network_description(name), fetched_file(name)
        print(f"{name}: {about.description}")
        print(f"  source   {about.source}")
        print(f"  licence  {about.licence}")
        print(f"  file     {path if path.is_file() else 'not fetched'}")


@app.command("fetch")
def fetch_network(
    name: Annotated[str, typer.Argument(help="As `trepid networks list` prints it.")],
    file: Annotated[
        Path | None,
        typer.Option(help="A copy that is on this machine already: the published file, or its ONNX file."),
    ] = None,
) -> None:
    """Get a network from its publisher, once; `network: NAME` in segments.yaml chooses it."""
    about, path = network_description(name), fetched_file(name)
    if file is not None and file.suffix == ONNX:
        Segmenter(file, about)  # raises InputError where it is another network
        store(path, file.read_bytes())
    else:
        store(path, _published_file(name, about, file))
    print(f"licence: {about.licence}")
    print(path)


def _published_file(name: str, about: SegmentNetwork, file: Path | None) -> bytes:
    """The ONNX file of what the publisher offers, or of the same in ``file``. Raises InputError."""
    if about.fetch is None:
        raise InputError(f"network {name}: its description names no address; `--file F.onnx` takes a file")
    address, known = about.fetch.address, about.fetch.sha256
    print(f"{address}\nsha256 {known}")
    content = download(address) if file is None else _read(file)
    found = hashlib.sha256(content).hexdigest()
    if found != known:
        raise InputError(f"{file or address}: its SHA-256 is {found}, expected {known}")
    if about.fetch.checkpoint == "onnx":
        return content
    try:
        from learning.twinlitenet import to_onnx
    except ImportError as error:
        raise InputError(
            f"network {name}: its export needs {error.name}: `pip install -e '.[train]' -c constraints.txt`"
        ) from error
    return to_onnx(content, about, str(file or address))


def _read(file: Path) -> bytes:
    try:
        return file.read_bytes()
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error
