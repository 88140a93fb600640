"""Pictures of rule files: what is drawn is what the rules say, and it can be read."""

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from cockpit.pictures.plot import FIVE, Axes, ticks
from cockpit.rulebook.cli import app
from cockpit.rulebook.figure import sets_figure, shown_range, surface, surface_figure
from cockpit.rulebook.show import SURFACE_COLUMNS, SURFACE_ROWS
from supervisor.rules.coverage import calmest
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import LEVELS
from trepid.config import CONFIG_DIR, InputError

FILE = CONFIG_DIR / "fear.yaml"
RULES = FearRules.load(FILE)


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
        inner = [x for level in LEVELS for x in getattr(spec.sets, level) if x not in spec.range]
        assert spec.range[0] <= low < min(inner) and max(inner) <= high <= spec.range[1]


@settings(max_examples=60)
@given(st.floats(-1e6, 1e6), st.floats(1e-3, 1e6))
def test_ticks_are_round_numbers_within_the_axis(low: float, span: float) -> None:
    found = ticks((low, low + span))
    assert 2 <= len(found) <= 8
    slack = 1e-6 * max(abs(low), span, 1.0)
    assert low - slack <= found[0] <= found[-1] <= low + span + slack
    assert np.allclose(np.diff(found), found[1] - found[0])


def test_axes_put_the_ends_of_their_ranges_into_their_corners() -> None:
    axes = Axes(10, 20, 110, 220, (0.0, 5.0), (-1.0, 1.0))
    assert axes.at(np.array([0.0, 5.0]), np.array([-1.0, 1.0])).tolist() == [[10, 220], [110, 20]]


def test_the_five_levels_stay_apart_for_the_colour_blind() -> None:
    """Neighbours differ in brightness, which everybody sees."""
    grey = [0.114 * b + 0.587 * g + 0.299 * r for b, g, r in FIVE]
    assert min(abs(a - b) for a, b in itertools.pairwise(grey)) > 20


def test_pictures_show_every_set_in_its_colour_and_the_surface_in_viridis() -> None:
    drawn = sets_figure(RULES)
    for colour in FIVE:
        assert (drawn == np.array(colour)).all(axis=-1).sum() > 1000
    figure = surface_figure(RULES, "lane_confidence", "speed", calmest(RULES))
    calm = cv2.applyColorMap(np.zeros((1, 1), np.uint8), cv2.COLORMAP_VIRIDIS)[0, 0]
    assert (figure == calm).all(axis=-1).any(), "fear 0, where the lane is surely seen"


@pytest.mark.parametrize("arguments", [[], ["--surface", "lane_confidence", "speed", "time_gap=1"]])
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
        (["--picture", "nowhere/p.png"], r"nowhere/p\.png: cannot be written"),
        (["--picture", "p.nonsense"], "no picture is called that"),
    ],
)
def test_what_cannot_be_shown_is_named(arguments: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        show(*arguments)
