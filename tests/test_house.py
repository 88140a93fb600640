"""The structure of the source tree: which room may import which, and how large files, rooms and classes may be.

A room is a folder with Python files. Imports inside functions count too; imports for type checking do not. Between
packages, names of modules given as strings count as well.
"""

import ast
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import networkx
import pytest

from trepid.config import CONFIG_DIR, ROOT
from trepid.packages import PACKAGES as TREPID

PACKAGES = (*TREPID, "lab")  # the laboratory is a package of its own, with its tests beside it
ROAD = {"trepid", "perception", "supervisor", "controller", "vehicle"}
ALLOWED = {
    "trepid": {"trepid"},
    "perception": {"trepid", "perception"},
    "supervisor": {"trepid", "supervisor"},
    "controller": {"trepid", "controller"},
    "vehicle": {"trepid", "controller", "vehicle"},  # the limiter, as the last step before the wire
    "drive": {*ROAD, "drive"},
    "cockpit": {*ROAD, "drive", "cockpit"},
    "sim_harness": {*ROAD, "drive", "cockpit", "sim_harness"},
    "learning": {*ROAD, "drive", "cockpit", "sim_harness", "learning"},
    "lab": set(PACKAGES),
}
MAX_FILES = 20
MAX_CLASS_LINES = 220
PARTICIPLE = re.compile(
    r"[a-z]{2,}ed|begun|bound|broken|brought|built|caught|chosen|done|drawn|driven|fallen|felt|found|frozen|given|"
    r"gone|grown|heard|held|hidden|kept|known|laid|learnt|made|meant|met|moved|paid|said|seen|sent|shown|"
    r"spent|spoken|stood|taken|thrown|told|understood|worn|written"
)
VERBS_AND_NOUNS = {"embed", "exceed", "feed", "need", "proceed", "seed", "shed", "speed"}
PREPOSITIONS = {"after", "at", "by", "for", "from", "in", "of", "on", "out", "to", "with"}
UNITS = {"deg", "m", "mps", "mps2", "ms", "percent", "px", "rad", "radps", "s"}
PUBLISHED_PARTICIPLES = {
    "ended",  # of a camera source, which other packages implement
    "oriented",  # a stage of config/pipelines.yaml
}
SETTINGS_OF_FILES = {"SightSettings"}  # of three files of config/; the name is the title in their schemas


@cache
def modules() -> dict[str, Path]:
    """Path of every module of the packages, by its dotted name."""
    found = {}
    for package in PACKAGES:
        folder = ROOT / package
        for path in sorted(set(folder.rglob("*.py")) - set((folder / "tests").rglob("*.py"))):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts)
            found[name.removesuffix(".__init__")] = path
    return found


class Source(NamedTuple):
    """What a file states: read once for all tests, without its tree, which would take a hundred times its size."""

    has_docstring: bool
    imports: tuple[str, ...]  # also those inside functions
    modules: tuple[str, ...]  # of the packages, in strings
    classes: tuple[tuple[str, int], ...]  # with their lines
    functions: tuple[str, ...]
    numbers: tuple[tuple[str, float], ...]


@cache
def source(path: Path) -> Source:
    """What the Python file ``path`` states."""
    tree = ast.parse(path.read_text())
    nodes = list(ast.walk(tree))
    return Source(
        ast.get_docstring(tree) is not None,
        tuple(imported_names(tree)),
        tuple(named_modules(nodes)),
        tuple((n.name, (n.end_lineno or 0) - n.lineno + 1) for n in nodes if isinstance(n, ast.ClassDef)),
        tuple(n.name for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)),
        tuple(numbers_of(nodes)),
    )


@cache
def room(module: str) -> str:
    """The folder of a module, as a dotted name."""
    return module if modules()[module].name == "__init__.py" else module.rpartition(".")[0]


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Dotted names that ``tree`` imports when it runs, also inside functions."""
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        if isinstance(child, ast.Import):
            yield from (alias.name for alias in child.names)
        elif isinstance(child, ast.ImportFrom) and child.module:
            yield child.module
            yield from (f"{child.module}.{alias.name}" for alias in child.names)
        if not isinstance(child, ast.expr):
            yield from imported_names(child)


@cache
def imports() -> networkx.DiGraph:
    """Which module imports which."""
    graph = networkx.DiGraph()
    graph.add_nodes_from(modules())
    for module, path in modules().items():
        names = source(path).imports
        graph.add_edges_from((module, name) for name in names if name in modules() and name != module)
    return graph


def circles(graph: networkx.DiGraph) -> list[list[str]]:
    """Groups of nodes that reach each other."""
    return [sorted(group) for group in networkx.strongly_connected_components(graph) if len(group) > 1]


def test_no_modules_import_each_other_in_a_circle() -> None:
    assert circles(imports()) == []


def test_no_rooms_import_each_other_in_a_circle() -> None:
    rooms = networkx.DiGraph((room(a), room(b)) for a, b in imports().edges if room(a) != room(b))
    assert circles(rooms) == []


def named_modules(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Modules below a package that strings of ``nodes`` name, alone, with an object, or as the start of a name."""
    for node in nodes:
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            name = node.value.partition(":")[0].rstrip(".")
            parts = name.split(".")
            found = (".".join(parts[:count]) for count in range(len(parts), 1, -1))
            yield from [one for one in found if one in modules()][:1]


def test_no_packages_name_each_other_in_a_circle_by_imports_or_strings() -> None:
    pairs = {(a.split(".")[0], b.split(".")[0]) for a, b in imports().edges}
    for module, path in modules().items():
        pairs |= {(module.split(".")[0], name.split(".")[0]) for name in source(path).modules}
    assert circles(networkx.DiGraph((a, b) for a, b in pairs if a != b)) == []


def test_a_module_in_a_string_counts_where_it_is_the_whole_text_or_its_object_is_named() -> None:
    tree = ast.parse("a = 'drive.cli'; b = 'vehicle.actuators.table:OWN'; c = 'see drive.plan'; d = 'drive'")
    assert list(named_modules(ast.walk(tree))) == ["drive.cli", "vehicle.actuators.table"]


def test_the_tests_of_trepid_run_without_the_laboratory() -> None:
    users = [
        f"{path}: {name}"
        for path in sorted((ROOT / "tests").rglob("*.py"))
        for name in source(path).imports
        if name.split(".")[0] == "lab"
    ]
    assert users == []


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_what_the_data_flow_allows(package: str) -> None:
    wrong = [
        (module, target)
        for module, target in imports().edges
        if module.split(".")[0] == package and target.split(".")[0] not in ALLOWED[package]
    ]
    assert wrong == []


def test_no_room_exceeds_the_limit_of_files() -> None:
    full = {name: count for name, count in Counter(map(room, modules())).items() if count > MAX_FILES}
    assert full == {}


def test_no_class_exceeds_the_limit_of_lines() -> None:
    long = {
        f"{module}.{name}": lines
        for module, path in modules().items()
        for name, lines in source(path).classes
        if lines > MAX_CLASS_LINES
    }
    assert long == {}


def test_every_module_and_room_has_a_docstring() -> None:
    bare = [module for module, path in modules().items() if not source(path).has_docstring]
    assert bare == []


def test_only_the_bus_imports_zenoh() -> None:
    users = {
        module
        for module, path in modules().items()
        if any(name.split(".")[0] == "zenoh" for name in source(path).imports)
    }
    assert users == {"trepid.bus"}


def test_a_class_name_means_at_most_two_things() -> None:
    places: dict[str, list[str]] = {}
    for module, path in modules().items():
        for name, _ in source(path).classes:
            places.setdefault(name, []).append(module)
    often = {
        name: where for name, where in places.items() if len(where) > 2 and name not in SETTINGS_OF_FILES
    }
    assert often == {}


def is_bare_participle(name: str) -> bool:
    """Whether a name says neither what it does nor what it gives: ``joined``, ``moved_m``, ``seen_from``."""
    words = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip("_")).lower().split("_")
    while len(words) > 1 and words[-1] in UNITS | PREPOSITIONS:
        words.pop()
    (word, *more) = words
    return not more and word not in VERBS_AND_NOUNS and PARTICIPLE.fullmatch(word) is not None


def test_no_function_or_class_is_named_by_a_bare_participle() -> None:
    tests = [path for folder in (ROOT / "tests", ROOT / "lab" / "tests") for path in folder.rglob("*.py")]
    bare = [
        f"{path}: {name}"
        for path in (*modules().values(), *tests)
        for name in (*source(path).functions, *dict(source(path).classes))
        if is_bare_participle(name) and name not in PUBLISHED_PARTICIPLES
    ]
    assert bare == []


# The supervisor compares lanes there; nothing aims at them.
OTHER_MEANINGS = {("supervisor.yaml", "min_lookahead_m")}
OWNERS = {
    ("vehicle.yaml", "standstill_mps"): re.compile(r"(?i)_?(standstill|standing)_mps"),
    ("perception.yaml", "lookahead_m"): re.compile(r"(?i)_?(\w+_)?(look_?ahead|aim)_m"),
    ("perception.yaml", "min_confidence"): re.compile(r"(?i)_?(min|least)_confidence"),
}
"""File and field that own a number, and the names by which other places would state it again."""


def stated_numbers(path: Path) -> Iterable[tuple[str, float]]:
    """Numbers in the fields of a YAML file, or that Python gives to names, fields and parameters: name, number."""
    if path.suffix != ".yaml":
        return source(path).numbers
    fields = re.findall(r"(\w+): *(\d+\.?\d*)(?=[\s,}]|$)", path.read_text())
    return [(name, float(number)) for name, number in fields]


def numbers_of(nodes: Iterable[ast.AST]) -> Iterator[tuple[str, float]]:
    for node in nodes:
        pairs: list[tuple[str, ast.expr | None]] = []
        if isinstance(node, ast.Assign):
            pairs = [(t.id, node.value) for t in node.targets if isinstance(t, ast.Name)]
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            pairs = [(node.target.id, node.value)]
        elif isinstance(node, ast.arguments):
            late = [*node.posonlyargs, *node.args][-len(node.defaults) :] if node.defaults else []
            both = [
                *zip(late, node.defaults, strict=True),
                *zip(node.kwonlyargs, node.kw_defaults, strict=True),
            ]
            pairs = [(one.arg, value) for one, value in both]
        for name, value in pairs:
            if isinstance(value, ast.Constant) and isinstance(value.value, float):
                yield name, value.value


@pytest.mark.parametrize("owner", OWNERS)
def test_a_number_of_many_readers_stands_in_one_file(owner: tuple[str, str]) -> None:
    file, field = owner
    own = CONFIG_DIR / file
    (number,) = {value for name, value in stated_numbers(own) if name == field}
    again = [
        f"{path}: {name}"
        for path in [*modules().values(), *CONFIG_DIR.glob("*.yaml")]
        for name, value in stated_numbers(path)
        if value == number
        and OWNERS[owner].fullmatch(name)
        and (path, name) != (own, field)
        and (path.name, name) not in OTHER_MEANINGS
    ]
    assert again == []


def test_a_number_counts_as_field_constant_and_default(tmp_path: Path) -> None:
    code, settings = tmp_path / "code.py", tmp_path / "settings.yaml"
    code.write_text("A_M = 1.0\nclass C:\n    b_m: float = 2.0\ndef f(x, c_m=3.0, *, d_m=4.0): ...\n")
    settings.write_text("e_m: 5.0  # 6.0\nf: {g_m: 7.0}\n")
    assert list(stated_numbers(code)) == [("A_M", 1.0), ("b_m", 2.0), ("c_m", 3.0), ("d_m", 4.0)]
    assert list(stated_numbers(settings)) == [("e_m", 5.0), ("g_m", 7.0)]


@pytest.mark.parametrize("name", ["joined", "_driven", "moved_m", "seen_from", "Recorded", "held_s"])
def test_a_participle_alone_with_its_unit_or_a_preposition_is_bare(name: str) -> None:
    assert is_bare_participle(name)


@pytest.mark.parametrize(
    "name", ["join_rows", "kept_size", "followed_vehicle", "speed_mps", "is_saturated", "Feed"]
)
def test_a_verb_a_noun_and_a_participle_before_a_noun_are_not_bare(name: str) -> None:
    assert not is_bare_participle(name)
