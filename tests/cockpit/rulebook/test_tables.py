"""The pages generated from the code are current."""

from pathlib import Path

import pytest

from cockpit.rulebook.tables import MODES_PAGE, TERMS_PAGE, WHY, pages, table
from supervisor.modes.analyser import SUSPECTS
from supervisor.modes.doubts import doubts_of
from supervisor.modes.modes import TRANSITIONS
from supervisor.rules.inference import FearRules
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, load


@pytest.mark.parametrize("path", [MODES_PAGE, TERMS_PAGE], ids=lambda p: p.name)
def test_the_page_is_current(path: Path) -> None:
    assert path.read_text() == pages()[str(path)], "run `python -m cockpit.rulebook.tables`"


def test_every_transition_and_every_suspect_is_on_the_page() -> None:
    page = pages()[str(MODES_PAGE)]
    assert all(page.count(row.because) >= 2 for row in TRANSITIONS)  # diagram and table
    assert all(f"`{suspect.cause}`" in page for suspect in SUSPECTS)


def test_every_delay_is_on_the_page_with_the_condition_that_ends_it() -> None:
    settings = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
    lines = pages()[str(MODES_PAGE)].splitlines()
    for doubt in doubts_of(settings.modes):
        assert any(doubt.name in line and line.endswith(f"| {doubt.cleared} |") for line in lines)


def test_every_term_has_a_reason_and_every_reason_a_term() -> None:
    assert set(WHY) == set(FearRules.load(CONFIG_DIR / "fear.yaml").names)


def test_a_bar_in_a_cell_does_not_end_it() -> None:
    assert table(["a"], [["|κ|"]]).splitlines()[-1] == "| \\|κ\\| |"
