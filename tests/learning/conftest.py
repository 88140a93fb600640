"""Cards of drives look at fewer frames in these tests: the kinds of road of a rendered drive do not change."""

import pytest

from learning.dataset import card


@pytest.fixture(scope="session", autouse=True)
def _few_looks():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(card, "LOOKED_AT", 24)
        yield
