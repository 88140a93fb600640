"""Options that several verbs share, and the command as it was typed.

Every verb that depends on the settings takes ``--car DIR``.
"""

import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer

from trepid.config import CAR, use_car


def _use(folder: Path | None) -> Path | None:
    if folder is not None:
        use_car(folder)
    return folder


Car = Annotated[
    Path | None,
    typer.Option(
        "--car",
        metavar="DIR",
        envvar=CAR,
        callback=_use,
        is_eager=True,  # before other options whose values are read from the settings
        expose_value=False,
        help="Folder of a car; its files override the defaults field by field.",
    ),
]
"""Type of the parameter ``car: Car = None``. The folder is in use before the verb begins; None: the defaults."""


Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Another value for a field of the scenario; may be repeated."
    ),
]
"""Type of the parameter ``changes: Changes = None``, for :func:`trepid.config.parse_overrides`."""


Chosen = Annotated[
    list[str] | None,
    typer.Option(
        "--estimator",
        metavar="NAME|F.onnx",
        help="Drive with this estimator or driving network instead of the usual ones; may be repeated.",
    ),
]
"""Type of the parameter ``chosen: Chosen = None``."""


RawImages = Annotated[
    bool,
    typer.Option(
        "--raw-images",
        help="With --record: also the images as the estimators get them, 350 MB a minute before compression, so"
        " that `trepid replay` repeats the estimators exactly.",
    ),
]
"""Type of the parameter ``raw_images: RawImages = False``."""


def typed_command() -> str:
    """``trepid`` and the words after it, quoted for a shell where they need it."""
    return shlex.join(["trepid", *sys.argv[1:]])
