"""The vocabulary of causes: every other name is refused with the nearest one."""

import pytest

from trepid.causes import CAUSES, known_causes, unknown_cause


@pytest.mark.parametrize("cause", sorted(CAUSES))
def test_a_known_cause_is_accepted_and_a_misspelt_one_gets_the_nearest_name(cause: str) -> None:
    assert unknown_cause(cause) == ""
    assert unknown_cause(f"{cause}x") == f"unknown cause '{cause}x'; did you mean '{cause}'?"


def test_a_declared_cause_is_known_where_it_is_declared() -> None:
    assert unknown_cause("ice") != ""
    assert unknown_cause("ice", known_causes(["ice"])) == ""
