"""The option ``--set KEY=VALUE`` of the verbs that drive scenarios."""

from typing import Annotated

import typer

Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Another value for a field of the scenario; may be repeated."
    ),
]
"""Type of the parameter ``changes: Changes = None``, for :func:`trepid.config.parse_overrides`."""
