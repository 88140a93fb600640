"""``import trepid``: light, typed and documented; docs/python.md names a function for every verb."""

import inspect
import json
import re
import subprocess
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
import typer

import trepid
from trepid.cli import app
from trepid.config import CAR, ROOT, InputError, car_folder

TABLE = re.compile(r"^\| `([a-z -]+)` \| (.+) \|$", re.MULTILINE)
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
FUNCTIONS = {verb: re.findall(r"`([\w.]+)`", text) for verb, text in TABLE.findall(PAGE)}
NOTEBOOKS = sorted((ROOT / "examples").glob("*.ipynb"))


def verbs(name: str, command: Any) -> Iterator[str]:
    children = getattr(command, "commands", {})
    if not children:
        yield name
    for child in children:
        yield from verbs(f"{name} {child}".strip(), children[child])


def resolve(dotted: str) -> Any:
    """The object with this dotted name."""
    parts = dotted.split(".")
    for count in range(len(parts) - 1, 0, -1):
        try:
            target = import_module(".".join(parts[:count]))
        except ModuleNotFoundError:
            continue
        for part in parts[count:]:
            target = getattr(target, part)
        return target
    raise AssertionError(dotted)


def test_the_page_names_a_function_of_every_verb() -> None:
    assert set(FUNCTIONS) == set(verbs("", typer.main.get_command(app)))


@pytest.mark.parametrize("verb", FUNCTIONS)
def test_the_functions_of_a_verb_exist_and_are_documented(verb: str) -> None:
    assert FUNCTIONS[verb]
    for name in FUNCTIONS[verb]:
        assert inspect.getdoc(resolve(name)), name


@pytest.mark.parametrize("name", sorted({*trepid.__all__} - {"__version__"}))
def test_a_name_of_the_package_has_types_and_a_docstring(name: str) -> None:
    target = getattr(trepid, name)
    assert inspect.getdoc(target)
    if inspect.isfunction(target):
        signature = inspect.signature(target)
        assert signature.return_annotation is not inspect.Signature.empty
        assert all(one.annotation is not inspect.Parameter.empty for one in signature.parameters.values())


def test_the_import_alone_imports_no_other_package() -> None:
    code = "import sys; before = set(sys.modules); import trepid; print(*sorted(set(sys.modules) - before))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    heavy = {"numpy", "cv2", "pydantic", "typer", "zenoh", "cockpit", "sim_harness", "perception"}
    assert "trepid" in done.stdout.split()
    assert heavy.isdisjoint(done.stdout.split())


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'estimat'"):
        trepid.estimat  # type: ignore[attr-defined]  # noqa: B018
    assert set(trepid.__all__) <= set(dir(trepid))


@pytest.mark.processes  # both cores for long
def test_mypy_reads_the_types_of_the_functions(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(
        "import trepid\n"
        "reveal_type(trepid.run('straight').trace)\n"
        "reveal_type(trepid.load().vehicle.wheelbase_m)\n"
        "trepid.sweep('all', seed='one')\n"
    )
    command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml"), str(script)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert 'Revealed type is "sim_harness.judging.trace.Trace"' in done.stdout, done.stdout + done.stderr
    assert 'Revealed type is "float"' in done.stdout
    assert 'Argument "seed" to "sweep" has incompatible type "str"' in done.stdout


def test_every_package_carries_the_mark_that_its_types_are_to_be_read() -> None:
    from trepid.packages import PACKAGES

    assert [name for name in PACKAGES if not (ROOT / name / "py.typed").is_file()] == []


def code_cells(path: Path) -> list[dict[str, Any]]:
    notebook = json.loads(path.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    return [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_a_notebook_is_small_and_stored_with_the_outputs_of_one_run_from_top_to_bottom(path: Path) -> None:
    cells = code_cells(path)
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert all(cell["outputs"] for cell in cells) and path.stat().st_size < 200_000
    kinds = {output["output_type"] for cell in cells for output in cell["outputs"]}
    assert kinds <= {"stream", "execute_result", "display_data"}  # no error


def first_form(text: str) -> str:
    """The first line that is printed, with 0 for every number and w for every word."""
    return re.sub(r"[A-Za-z_]+", "w", re.sub(r"-?\d+(\.\d+)?", "0", text.partition("\n")[0]))


@pytest.mark.long
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_every_cell_of_a_notebook_runs_and_prints_in_the_form_of_its_stored_output(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    shared: dict[str, Any] = {"__name__": "__main__"}
    for number, cell in enumerate(code_cells(path)):
        exec(compile("".join(cell["source"]), f"{path.name}[{number}]", "exec"), shared)
        stored = "".join(line for one in cell["outputs"] for line in one.get("text", ()))
        assert first_form(capsys.readouterr().out) == first_form(stored), number
    assert NOTEBOOKS


def test_the_car_of_a_call_is_in_use_only_within_it(tmp_path: Path) -> None:
    (tmp_path / "vehicle.yaml").write_text("wheelbase_m: 1.9\n")
    assert trepid.load(tmp_path).vehicle.wheelbase_m == 1.9
    assert trepid.load(tmp_path).settings("vehicle")["wheelbase_m"] == 1.9
    assert trepid.load().vehicle.wheelbase_m != 1.9
    assert car_folder() is None


def test_without_a_folder_the_car_of_the_environment_is_loaded_and_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "vehicle.yaml").write_text("wheelbase_m: 1.9\n")
    monkeypatch.setenv(CAR, str(tmp_path))
    car = trepid.load()
    assert (car.folder, car.vehicle.wheelbase_m) == (tmp_path, 1.9)
    monkeypatch.setenv(CAR, "")
    assert car.settings("vehicle")["wheelbase_m"] == 1.9
    assert trepid.load().folder is None


def test_wrong_input_raises_the_line_of_the_command_line(tmp_path: Path) -> None:
    (tmp_path / "vehicle.yaml").write_text("wheelbase_m: long\n")
    with pytest.raises(trepid.InputError, match=r"vehicle.yaml:1:1: wheelbase_m"):
        trepid.load(tmp_path)
    with pytest.raises(InputError, match="no scenario 'moon'"):
        trepid.run("moon")
    with pytest.raises(InputError, match="no estimator 'oracle'"):
        next(trepid.estimate("road.jpg", "oracle"))
    with pytest.raises(InputError, match="no settings 'vehicel'"):
        trepid.load().settings("vehicel")
