"""Settings: valid files load exactly; errors give place and fault in one line."""

from io import StringIO
from pathlib import Path
from typing import Annotated, Literal

import pytest
from pydantic import Field

from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CAR, CONFIG_DIR, InputError, Settings, editing_yaml, load, resource


class Inner(Settings):
    gain: float
    points: tuple[float, ...] = ()


class Outer(Settings):
    name: str
    inner: Inner


GOOD = "name: a\ninner:\n  gain: 1.5\n  points: [1, 2]\n"


def write(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "settings.yaml"
    path.write_text(text)
    return path


def test_a_good_file_loads_with_its_values(tmp_path: Path) -> None:
    assert load(write(tmp_path, GOOD), Outer) == Outer(name="a", inner=Inner(gain=1.5, points=(1, 2)))


def test_an_override_replaces_one_nested_value(tmp_path: Path) -> None:
    settings = load(write(tmp_path, GOOD), Outer, overrides={"inner.gain": "2.5"})
    assert settings.inner == Inner(gain=2.5, points=(1, 2))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("name: a\ninner:\n  gain: fast\n", "settings.yaml:3:3: inner.gain: "),
        ("name: a\ninner:\n  points: [1]\n", "settings.yaml:2:1: 'inner.gain' is missing"),
        (
            "name: a\ninner:\n  gian: 1\n",
            "settings.yaml:3:3: unknown field 'inner.gian'; did you mean 'gain'?",
        ),
        (
            "name: a\ninner:\n  gain: 1\n  gian: 1\n",
            "settings.yaml:4:3: unknown field 'inner.gian'; did you mean 'gain'?",
        ),
        ("name: a\ninner: {gain: .nan}\n", "settings.yaml:2:9: inner.gain: "),
        ("name: a\ninner:\n  gain: 1\n  points: [1, x]\n", "settings.yaml:4:15: inner.points.1: "),
        ("name: [a\n", "settings.yaml:2:1: not valid YAML"),
        ("- a\n", "settings.yaml:1:1: expected a mapping"),
        ("", "settings.yaml:1:1: expected a mapping"),
        ("name: a\nname: b\n", "settings.yaml:2:1: not valid YAML"),
    ],
)
def test_a_bad_file_is_named_with_line_and_column(tmp_path: Path, text: str, expected: str) -> None:
    with pytest.raises(InputError) as error:
        load(write(tmp_path, text), Outer)
    assert expected in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    [
        "name:\ta\ninner:\n  gain:\t 1\n  points:\n    -\t1\n    - \t2\n",
        "name: a\t\ninner:\t# spread\n\t\n  gain: 1\t# \n  points: [1,\t2\t]\n",
    ],
)
def test_tabs_between_a_name_and_its_value_and_at_the_end_of_a_line_mean_nothing(
    tmp_path: Path, text: str
) -> None:
    path, out = write(tmp_path, text), StringIO()
    expected = Outer(name="a", inner=Inner(gain=1.0, points=(1.0, 2.0)))
    assert load(path, Outer) == expected
    yaml = editing_yaml()
    yaml.dump(yaml.load(text), out)
    assert load(write(tmp_path, out.getvalue()), Outer) == expected and out.getvalue().count(
        "#"
    ) == text.count("#")


@pytest.mark.parametrize(("text", "column"), [("inner:\n\tgain: 1\n", 1), ("inner:\n \tgain: 1\n", 2)])
def test_a_tab_that_indents_is_refused_with_its_place(tmp_path: Path, text: str, column: int) -> None:
    with pytest.raises(InputError, match=rf"settings\.yaml:2:{column}: not valid YAML: a tab; write spaces"):
        load(write(tmp_path, text), Outer)


def test_a_bad_override_is_blamed_on_the_command_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--set inner.gain: inner.gain: "):
        load(write(tmp_path, GOOD), Outer, overrides={"inner.gain": "fast"})


class Bend(Settings):
    kind: Literal["bend"]
    radius_m: float


class Line(Settings):
    kind: Literal["line"]
    length_m: float


class Route(Settings):
    parts: tuple[Annotated[Bend | Line, Field(discriminator="kind")], ...]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("parts:\n- {kind: bend, radius_m: x}\n", "settings.yaml:2:16: parts.0.radius_m: "),
        ("parts:\n- {kind: line}\n", "settings.yaml:2:3: 'parts.0.length_m' is missing"),
        (
            "parts:\n- {kind: bend, radius: 3}\n",
            "settings.yaml:2:16: unknown field 'parts.0.radius'; did you mean 'radius_m'?",
        ),
    ],
)
def test_a_mistake_in_a_member_of_a_union_is_named_as_it_stands_in_the_file(
    tmp_path: Path, text: str, expected: str
) -> None:
    with pytest.raises(InputError) as error:
        load(write(tmp_path, text), Route)
    assert expected in str(error.value)


def test_an_override_reaches_into_lists(tmp_path: Path) -> None:
    path = write(tmp_path, "parts: [{kind: bend, radius_m: 1}, {kind: line, length_m: 2}]\n")
    route = load(path, Route, overrides={"parts.1.length_m": "5"})
    assert route.parts == (Bend(kind="bend", radius_m=1), Line(kind="line", length_m=5))
    with pytest.raises(InputError, match=r"--set parts.2.length_m: no item '2' in a list of 2"):
        load(path, Route, overrides={"parts.2.length_m": "5"})
    with pytest.raises(InputError, match=r"--set parts.x: no item 'x' in a list of 2"):
        load(path, Route, overrides={"parts.x": "5"})


def test_an_override_of_one_alias_leaves_the_others(tmp_path: Path) -> None:
    text = "parts: [&same {kind: line, length_m: 2}, *same]\n"
    route = load(write(tmp_path, text), Route, overrides={"parts.0.length_m": "5"})
    assert [part.length_m for part in route.parts] == [5, 2]


@pytest.mark.parametrize("content", [None, b"\xff\xfe\x00"])
def test_a_missing_or_binary_file_is_named(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "settings.yaml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"settings\.yaml"):
        load(path, Outer)


def test_the_shipped_vehicle_and_camera_load() -> None:
    assert load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m > 0
    assert load(CONFIG_DIR / "camera.yaml", Camera).height_m > 0


def test_a_file_of_the_settings_is_that_of_the_car_else_that_of_the_installation(tmp_path, monkeypatch):
    car, installed = tmp_path / "car", tmp_path / "installed" / "defaults"
    for top in (car / "config", installed):
        top.mkdir(parents=True)
        (top / "map.yaml").touch()
    monkeypatch.setattr("trepid.config.CONFIG_DIR", installed)
    monkeypatch.setenv(CAR, "")
    assert resource(Path("config/map.yaml")) == installed / "map.yaml"
    monkeypatch.setenv(CAR, str(car))
    assert resource(Path("config/map.yaml")) == car / "config" / "map.yaml"
    assert resource(Path("config/other.yaml")) == installed / "other.yaml"
