"""Pictures of rule files agree with the rules and are legible."""

import itertools
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from typer.testing import CliRunner

from cockpit.rulebook.cli import app
from cockpit.rulebook.figure import sets_figure, shown_range, surface, surface_figure
from cockpit.rulebook.show import SURFACE_COLUMNS, SURFACE_ROWS
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from supervisor.rules.rule_file import LEVELS
from trepid.config import CONFIG_DIR, ROOT, InputError
from trepid.images.figure_style import FEAR_COLOURS

pytestmark = pytest.mark.long

FILE = CONFIG_DIR / "fear.yaml"
RULES = FearRules.load(FILE)
SURFACE = ["--surface", "lane_confidence", "speed"]


def show(*arguments: str) -> str:
    result = CliRunner().invoke(app, ["show", str(FILE), *arguments])
    if isinstance(result.exception, InputError):
        raise result.exception
    assert result.exit_code == 0
    return result.stdout


def test_a_surface_is_the_fear_of_the_rules_at_every_sample() -> None:
    calm = calmest(RULES)
    x, y, fear = surface(RULES, "lane_confidence", "speed", calm, (7, 5))
    assert fear.shape == (5, 7)
    for row, column in np.ndindex(5, 7):
        values = {**calm, "lane_confidence": float(x[column]), "speed": float(y[row])}
        assert fear[row, column] == RULES.evaluate(values).fear


def test_every_corner_of_every_set_within_the_range_is_shown() -> None:
    for spec in RULES.inputs.values():
        low, high = shown_range(spec)
        inner = [x for level in LEVELS for x, _ in spec.shapes[level].corners() if x not in spec.range]
        assert spec.range[0] <= low < min(inner) and max(inner) <= high <= spec.range[1]


def test_the_five_levels_are_distinguishable_with_colour_blindness() -> None:
    """Neighbours differ in brightness, which every reader distinguishes."""
    rgb = [[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in FEAR_COLOURS]
    grey = [0.114 * b + 0.587 * g + 0.299 * r for r, g, b in rgb]
    assert min(abs(a - b) for a, b in itertools.pairwise(grey)) > 20


@pytest.fixture(scope="module")
def sets() -> Figure:
    return sets_figure(RULES)


def test_the_sets_are_drawn_with_their_colours_names_and_units(sets: Figure) -> None:
    figure = sets
    cells = {axes.get_title(loc="left"): axes for axes in figure.axes}
    assert cells.keys() == {*RULES.names, "action"}
    for name, spec in RULES.inputs.items():
        colours = [line.get_color() for line in cells[name].get_lines()]
        assert colours == list(FEAR_COLOURS if spec.risk == "rising" else FEAR_COLOURS[::-1])
        assert cells[name].get_xlabel().startswith(name)
        assert spec.unit == "1" or f"[{spec.unit}]" in cells[name].get_xlabel()


def test_no_text_of_the_figure_covers_another_one(sets: Figure) -> None:
    figure = sets
    figure.canvas.draw()
    texts = [text for axes in figure.axes for text in (axes._left_title, axes.xaxis.label, *axes.texts)]
    boxes = [text.get_window_extent() for text in [*texts, *figure.texts] if text.get_text()]
    assert not [(a, b) for a, b in itertools.combinations(boxes, 2) if a.overlaps(b)]


def test_the_surface_shows_the_fear_of_the_rules_in_viridis() -> None:
    figure = surface_figure(RULES, "lane_confidence", "speed", calmest(RULES))
    mesh = figure.axes[0].collections[0]
    fear = surface(RULES, "lane_confidence", "speed", calmest(RULES))[2]
    assert np.array_equal(np.ravel(mesh.get_array()), fear.ravel())
    assert (mesh.get_cmap().name, mesh.get_clim()) == ("viridis", (0, 1))
    assert figure.axes[0].get_ylabel() == "speed [m/s]"


def test_matplotlib_is_loaded_when_a_picture_is_drawn_and_not_before() -> None:
    code = (
        "import sys, cockpit.rulebook.cli; sys.exit('matplotlib' in sys.modules or 'skfuzzy' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize("arguments", [[], [*SURFACE, "time_gap=1"]])
def test_the_verb_writes_a_picture(tmp_path: Path, arguments: list[str]) -> None:
    path = tmp_path / "p.png"
    assert show("--picture", str(path), *arguments) == ""
    image = cv2.imread(str(path))
    assert image is not None and image.shape[1] > 1000


def test_the_terminal_shows_the_surface_with_axes_and_units() -> None:
    lines = show("--surface", "lane_confidence", "speed").splitlines()
    rows = [line.split("│")[1] for line in lines if "│" in line]
    assert len(rows) == SURFACE_ROWS and {len(row) for row in rows} == {SURFACE_COLUMNS}
    assert rows[0][0] == "▓" and rows[0][-1] == "·", "high where no lane is seen, very low where it surely is"
    assert any("speed [m/s], more is worse" in line for line in lines)
    assert any("lane_confidence [1], less is worse" in line for line in lines)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--surface", "lane_confidnce", "speed"], "did you mean 'lane_confidence'"),
        (["--surface", "speed", "speed"], "two different inputs are needed"),
        (["--picture", "nowhere/p.png", *SURFACE], r"nowhere/p\.png: cannot be written"),
        (["--picture", "p.nonsense", *SURFACE], "unknown format of a picture; known: "),
    ],
)
def test_a_figure_that_cannot_be_drawn_is_refused_with_its_reason(arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        show(*arguments)
