"""The option ``--estimator`` of the verbs that drive: other estimators than those of the scenario or the car."""

from typing import Annotated

import typer

Chosen = Annotated[
    list[str] | None,
    typer.Option(
        "--estimator",
        metavar="NAME|F.onnx",
        help="Drive with this estimator or driving network instead of the usual ones; may be repeated.",
    ),
]
"""Type of the parameter ``chosen: Chosen = None``."""
