"""The option ``--car DIR``, which every verb that depends on the settings takes."""

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
