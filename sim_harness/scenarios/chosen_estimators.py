"""Estimators that are chosen on the command line, as changes of a scenario."""

import json
from collections.abc import Mapping, Sequence

from drive.open_road import networks_of


def changes_of(designations: Sequence[str] | None) -> Mapping[str, str]:
    """The changes, as of ``--set``, that give a scenario these estimators; none without any. Raises InputError."""
    if not designations:
        return {}
    files = networks_of(designations)
    networks = {name: file for name, file in files.items() if file is not None}
    return {"estimators": json.dumps([*files]), "networks": json.dumps(networks)}
