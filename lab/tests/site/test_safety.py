"""docs/safety.md is generated, names what exists, and leaves out no limit of the safeguards."""

import re

import pytest

from lab.site import fields
from lab.site.safety import PAGE, Claim, claims, page
from trepid.config import ROOT

RESULTS = (ROOT / "lab" / "results" / "README.md").read_text(encoding="utf-8")
WHOLE = ("limiter", "measurement")
"""Files of which every field is a limit."""
SECTIONS = ("sight", "giving_way", "follow", "fusion", "modes", "validation")
"""... and sections of supervisor.yaml."""


def test_the_page_is_that_of_the_table() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m lab.site.safety"


@pytest.mark.parametrize("claim", claims(), ids=lambda claim: claim.claim)
def test_code_tests_pages_and_results_of_a_claim_exist_and_it_says_what_it_leaves_open(claim: Claim) -> None:
    for path in [*claim.code, *claim.tests]:
        assert (ROOT / path).exists(), path
    assert (PAGE.parent / claim.page.partition("#")[0]).exists()
    assert all(re.search(rf"^## {name}$", RESULTS, re.MULTILINE) for name in claim.measured)
    assert claim.tests and claim.remains


def test_every_limit_of_limiter_measurements_and_supervisor_belongs_to_one_claim() -> None:
    stated = [row.name for claim in claims() for row in claim.rows]
    wanted = {f"{file}.{row.name}" for file in WHOLE for row in fields.rows(file)}
    wanted |= {
        f"supervisor.{row.name}" for row in fields.rows("supervisor") if row.name.split(".")[0] in SECTIONS
    }
    assert wanted <= set(stated)
    assert len(stated) == len(set(stated))


def test_a_claim_with_an_unknown_limit_is_refused() -> None:
    with pytest.raises(KeyError, match=r"limiter\.no_such"):
        _ = claims()[0]._replace(limits=["limiter.no_such"]).rows
