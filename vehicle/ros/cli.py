"""The ``ros`` verbs."""

from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(no_args_is_help=True)


@app.callback()
def ros() -> None:
    """Group of the verbs, also while there is only one."""


@app.command()
def package(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The src folder of a ROS 2 workspace.")],
) -> int:
    """Write the messages of Trepid as the source of the ROS 2 package trepid_msgs, for colcon."""
    from vehicle.ros.package import write_package

    print(write_package(folder))
    return 0
