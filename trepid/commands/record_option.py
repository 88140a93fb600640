"""The option ``--raw-images`` of the verbs that record."""

from typing import Annotated

import typer

RawImages = Annotated[
    bool,
    typer.Option(
        "--raw-images",
        help="With --record: also the images as the estimators get them, 350 MB a minute before compression, so"
        " that `trepid replay` repeats the estimators exactly.",
    ),
]
"""Type of the parameter ``raw_images: RawImages = False``."""
