"""`trepid ros package`: a folder that colcon would build, with every message and none twice."""

import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.cli import main
from trepid.wire import DERIVED, STORE, ros_name


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("sys.argv", ["trepid", "ros", "package", str(tmp_path / "src")])
    assert main() == 0
    return tmp_path / "src" / "trepid_msgs"


def test_the_build_file_lists_every_message_file(package: Path) -> None:
    listed = set(re.findall(r'"(msg/\w+\.msg)"', (package / "CMakeLists.txt").read_text()))
    assert listed == {f"msg/{path.name}" for path in (package / "msg").iterdir()}
    assert len(listed) == len(DERIVED)


def test_the_manifest_names_the_generators_and_the_group_of_interfaces(package: Path) -> None:
    root = ElementTree.parse(package / "package.xml").getroot()
    assert root.findtext("name") == "trepid_msgs"
    assert root.findtext("member_of_group") == "rosidl_interface_packages"
    assert "rosidl_default_generators" in [node.text for node in root.findall("buildtool_depend")]


def test_the_files_give_the_type_hashes_that_are_on_the_wire(package: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    for message_type in DERIVED:
        text = (package / "msg" / f"{message_type.__name__}.msg").read_text()
        store.register(get_types_from_msg(text, ros_name(message_type)))
        assert store.hash_rihs01(ros_name(message_type)) == STORE.hash_rihs01(ros_name(message_type))


def test_field_names_are_those_that_ros_allows() -> None:
    for message_type in DERIVED:
        for name, _ in STORE.fielddefs[ros_name(message_type)][1]:
            assert re.fullmatch(r"[a-z](_?[a-z0-9]+)*", name), f"{message_type.__name__}.{name}"


def test_an_existing_package_is_not_overwritten(package: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main() == 2
    assert "exists; remove it" in capsys.readouterr().err
