"""Estimators that are chosen on the command line: names, and files of driving networks."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from perception.estimators import NETWORK_SUFFIX, name_of


def networks_of(designations: Sequence[str]) -> dict[str, str | None]:
    """The names of estimators given by names or files, and the file of each driving network. Raises InputError."""
    return {
        name_of(text): str(Path(text).resolve()) if text.endswith(NETWORK_SUFFIX) else None
        for text in designations
    }


def changes_of(designations: Sequence[str] | None) -> Mapping[str, str]:
    """The changes, as of ``--set``, that give a scenario these estimators; none without any. Raises InputError."""
    if not designations:
        return {}
    files = networks_of(designations)
    networks = {name: file for name, file in files.items() if file is not None}
    return {"estimators": json.dumps([*files]), "networks": json.dumps(networks)}
