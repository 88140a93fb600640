"""The ``ros`` verbs: the messages of Trepid as the source of a ROS 2 package, ``trepid_msgs``, for colcon."""

from pathlib import Path
from typing import Annotated

import typer

from trepid import __version__
from trepid.config import InputError
from trepid.wire import DERIVED, msg_text

NAME = "trepid_msgs"
PACKAGE_XML = f"""<?xml version="1.0"?>
<?xml-model href="http://download.ros.org/schema/package_format3.xsd" schematypens="http://www.w3.org/2001/XMLSchema"?>
<package format="3">
  <name>{NAME}</name>
  <version>{__version__}</version>
  <description>Messages of Trepid, a camera lane keeper (trepid ros package)</description>
  <maintainer email="maintainers@example.org">The maintainers of Trepid</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>std_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""
CMAKE = """cmake_minimum_required(VERSION 3.8)
project({name})

find_package(ament_cmake REQUIRED)
find_package(rosidl_default_generators REQUIRED)
find_package(std_msgs REQUIRED)

rosidl_generate_interfaces(${{PROJECT_NAME}}
{messages}
  DEPENDENCIES std_msgs
)

ament_export_dependencies(rosidl_default_runtime)
ament_package()
"""


def package_files() -> dict[str, str]:
    """Text of every file of the package by its path."""
    texts = {f"msg/{message_type.__name__}.msg": msg_text(message_type) for message_type in DERIVED}
    listed = "\n".join(f'  "{path}"' for path in sorted(texts))
    return {
        "package.xml": PACKAGE_XML,
        "CMakeLists.txt": CMAKE.format(name=NAME, messages=listed),
        **texts,
    }


def write_package(folder: Path) -> Path:
    """Write the package as ``folder/trepid_msgs``. Raises InputError when it exists or cannot be written."""
    target = folder / NAME
    try:
        target.mkdir(parents=True)
        (target / "msg").mkdir()
        for path, text in package_files().items():
            (target / path).write_text(text, encoding="utf-8")
    except FileExistsError as error:
        raise InputError(f"{target}: exists; remove it, or name another folder") from error
    except OSError as error:
        raise InputError(f"{target}: {error.strerror}") from error
    return target


app = typer.Typer(no_args_is_help=True)


@app.callback()
def ros() -> None:
    """Group of the verbs, also while there is only one."""


@app.command()
def package(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="The src folder of a ROS 2 workspace.")],
) -> int:
    """Write the messages of Trepid as the source of the ROS 2 package trepid_msgs, for colcon."""
    print(write_package(folder))
    return 0
