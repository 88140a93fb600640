"""One colour means one thing on the page, in reports, in figures and on the terminal."""

import colorsys
import re
from itertools import combinations
from pathlib import Path

import pytest
from rich.color import Color

import cockpit.page
import sim_harness.report
from drive.cli import FEAR_COLOURS as TERMINAL
from trepid.images.figure_style import ESTIMATORS, FEAR_COLOURS, LEAD, PATH, estimator_colours

PAGE = (Path(cockpit.page.__path__[0]) / "static/page.css").read_text(encoding="utf-8")
REPORT = (Path(sim_harness.report.__path__[0]) / "page.html").read_text(encoding="utf-8")
HUES_DEG = {  # of what a colour means, on light and on dark paper
    "fear": (0, 175),
    "path": (180, 195),
    "cv": (198, 210),
    "lead": (275, 295),
    "cnn": (318, 335),
}


def hue_deg(colour: str) -> float:
    """Hue of #RRGGBB: red 0, green 120, blue 240."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return 360 * colorsys.rgb_to_hsv(red, green, blue)[0]


def means(colour: str) -> str:
    """The one meaning that has the hue of ``colour``."""
    (meaning,) = (name for name, (low, high) in HUES_DEG.items() if low <= hue_deg(colour) <= high)
    return meaning


def variables(style: str) -> list[tuple[str, str]]:
    """Names and values of the colours of a style sheet, on light paper and on dark."""
    return re.findall(r"--([a-z0-9]+): (#[0-9a-f]{6});", style)


def test_no_two_meanings_share_a_hue() -> None:
    for (_, one), (_, other) in combinations(HUES_DEG.items(), 2):
        assert one[1] < other[0] or other[1] < one[0]


def test_figures_have_the_colour_of_each_meaning() -> None:
    assert {means(colour) for colour in FEAR_COLOURS} == {"fear"}
    assert {name: means(colour) for name, colour in ESTIMATORS.items()} == {"cv": "cv", "cnn": "cnn"}
    assert (means(PATH), means(LEAD)) == ("path", "lead")


def test_an_estimator_has_the_same_colour_beside_any_other() -> None:
    alone, beside = estimator_colours(["cnn"]), estimator_colours(["segments", "cv", "arcs", "cnn"])
    assert alone["cnn"] == beside["cnn"] and len(set(beside.values())) == 4
    assert not {*beside.values()} & {*FEAR_COLOURS, LEAD, PATH}


@pytest.mark.parametrize("style", [PAGE, REPORT], ids=["page", "report"])
def test_the_variables_of_a_style_sheet_have_the_colour_of_their_meaning(style: str) -> None:
    found = [(re.sub(r"risk\d", "fear", name), value) for name, value in variables(style)]
    judged = [(name, means(value)) for name, value in found if name in HUES_DEG]
    assert len(judged) >= 2 and all(name == meaning for name, meaning in judged)


def test_what_is_drawn_into_the_picture_of_the_page_has_the_colours_of_its_legend_on_dark_paper() -> None:
    script = (Path(cockpit.page.__path__[0]) / "static/camera.js").read_text(encoding="utf-8")
    drawn = dict(re.findall(r'(\w+): "(#[0-9a-f]{6})"', script))
    dark = dict(variables(PAGE))  # the later ones
    assert {name: drawn[name] for name in ("cv", "cnn", "path", "lead")} == {
        name: dark[name] for name in ("cv", "cnn", "path", "lead")
    }


def test_the_least_and_the_greatest_fear_are_green_and_red_everywhere() -> None:
    for risk, low, high in (("risk1", 140, 175), ("risk5", 0, 10)):
        hues = [hue_deg(value) for name, value in variables(PAGE) if name == risk]
        assert len(hues) == 2 and all(low <= hue <= high for hue in hues)
    assert hue_deg(FEAR_COLOURS[0]) > 140 and hue_deg(FEAR_COLOURS[-1]) < 10


def test_the_banner_is_coloured_by_fear_and_purple_while_a_vehicle_is_followed() -> None:
    modes = dict(re.findall(r"data-mode=([A-Z]+)\] \{[^}]*background: (#[0-9a-f]{6});", PAGE))
    judged = {mode: means(colour) for mode, colour in modes.items()}
    assert judged == {"KEEP": "fear", "CAUTION": "fear", "FOLLOW": "lead", "STOP": "fear"}
    assert re.search(r"\.band\.FOLLOW \{ fill: var\(--lead\)", REPORT)


def test_the_terminal_shows_fear_from_green_over_amber_to_red() -> None:
    colours = [Color.parse(name).get_truecolor().hex for name in TERMINAL.values()]
    hues = [hue_deg(colour) for colour in colours]
    assert hues == sorted(hues, reverse=True) and {means(colour) for colour in colours} == {"fear"}
