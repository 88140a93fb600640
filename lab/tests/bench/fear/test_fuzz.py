"""Broken numbers never calm."""

import random

import pytest

from lab.bench.fear.fuzz import Afraid, at_random, is_lower, numbers, one_by_one, situations
from trepid.messages import SteeringEstimate

AFRAID = Afraid()
WHOLE = situations()


@pytest.mark.parametrize("name", WHOLE)
def test_no_broken_number_lowers_fear(name: str) -> None:
    clean = AFRAID.fear(WHOLE[name], WHOLE[name])
    calmed = [
        broken for broken in one_by_one(WHOLE[name]) if is_lower(clean, AFRAID.fear(WHOLE[name], broken))
    ]
    assert calmed == []


def test_several_broken_numbers_do_not_lower_fear() -> None:
    rng = random.Random(0)
    for _ in range(100):
        name = rng.choice(list(WHOLE))
        assert AFRAID.fear(WHOLE[name], at_random(WHOLE[name], rng)) >= AFRAID.fear(WHOLE[name], WHOLE[name])


def test_the_situations_have_fear_that_could_be_lowered() -> None:
    fears = [AFRAID.fear(intact, intact) for intact in WHOLE.values()]
    assert min(fears) < 0.1 and sum(fear > 0.1 for fear in fears) >= len(fears) - 3


def test_the_numbers_of_a_message_are_its_floats() -> None:
    assert "t_s" in numbers(WHOLE["calm"]["state"])
    assert "lanes_detected" not in numbers(WHOLE["calm"]["cv"])
    assert isinstance(WHOLE["calm"]["cv"], SteeringEstimate)
