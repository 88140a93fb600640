import numpy as np
import pytest

from sim_harness.world.streets import StreetKind, random_street


@pytest.mark.parametrize("kind", list(StreetKind))
def test_every_kind_of_street_is_drawn(kind):
    street = random_street(kind, np.random.default_rng(3), from_m=10.0)
    assert street.road.name == kind
    assert any(True for _ in street.vehicles) or kind != StreetKind.PARKING
