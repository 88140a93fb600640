"""Quick frozen dataclasses against the plain ones that they stand for."""

import copy
import inspect
import pickle
from dataclasses import FrozenInstanceError, dataclass, field, fields, replace

import pytest

from trepid.frozen import record
from trepid.messages import Command, SimTruth


@dataclass(frozen=True, slots=True, kw_only=True)
class Plain:
    near_m: float
    name: str = "a"
    marks: tuple[float, ...] = ()


@record
class Quick:
    near_m: float
    name: str = "a"
    marks: tuple[float, ...] = ()


def test_has_the_fields_signature_and_repr_of_the_plain_class():
    assert [(f.name, f.type, f.default) for f in fields(Quick)] == [
        (f.name, f.type, f.default) for f in fields(Plain)
    ]
    assert inspect.signature(Quick).parameters == inspect.signature(Plain).parameters
    assert repr(Quick(near_m=1.0)) == repr(Plain(near_m=1.0)).replace("Plain", "Quick")


def test_compares_hashes_copies_and_pickles_as_the_plain_class():
    one, same, other = Quick(near_m=1.0), Quick(near_m=1.0, name="a"), Quick(near_m=1.0, marks=(2.0,))
    assert type(one) is Quick and one == same and one != other and hash(one) == hash(same)
    assert replace(one, marks=(2.0,)) == other
    assert copy.deepcopy(other) == other == pickle.loads(pickle.dumps(other))


@pytest.mark.parametrize("given", [{}, {"near_m": 1.0, "far_m": 2.0}, {"name": "b"}])
def test_takes_exactly_its_fields(given):
    with pytest.raises(TypeError):
        Quick(**given)
    with pytest.raises(TypeError):
        Quick(1.0)


def test_an_instance_is_immutable():
    made = Quick(near_m=1.0)
    with pytest.raises(FrozenInstanceError):
        made.near_m = 2.0
    with pytest.raises(FrozenInstanceError):
        del made.near_m
    with pytest.raises((FrozenInstanceError, TypeError)):
        made.far_m = 2.0
    assert made.near_m == 1.0 and not hasattr(made, "__dict__")


@pytest.mark.parametrize("message_type", [Command, SimTruth])
def test_messages_are_locked(message_type):
    message = message_type(**{f.name: 0.0 for f in fields(message_type)})
    with pytest.raises(FrozenInstanceError):
        message.t_s = 1.0


def test_fields_that_the_constructor_cannot_fill_are_refused():
    class WithFactory:
        items: list[float] = field(default_factory=list)

    class OutsideTheConstructor:
        x_m: float = field(init=False)

    class WithPostInit:
        x_m: float

        def __post_init__(self) -> None:
            pass

    for wrong in (WithFactory, OutsideTheConstructor, WithPostInit):
        with pytest.raises(TypeError, match="without a factory"):
            record(wrong)


def test_a_subclass_with_more_room_cannot_pass_for_it():
    class More(Quick):
        pass

    with pytest.raises(TypeError):
        More(near_m=1.0)
