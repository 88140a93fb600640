"""The order of image files in a folder."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from trepid.images.files import natural_order


def ordered(*names: str) -> list[str]:
    return [path.name for path in natural_order(map(Path, names))]


def test_numbers_in_names_count_by_value() -> None:
    assert ordered("100.jpg", "2.jpg", "10.jpg", "1.jpg") == ["1.jpg", "2.jpg", "10.jpg", "100.jpg"]
    assert ordered("run2_frame10.png", "run10_frame1.png", "run2_frame9.png") == [
        "run2_frame9.png",
        "run2_frame10.png",
        "run10_frame1.png",
    ]


def test_names_without_numbers_are_in_alphabetical_order() -> None:
    assert ordered("b.png", "A.jpg", "c.png") == ["A.jpg", "b.png", "c.png"]


@given(st.lists(st.integers(0, 10**9), unique=True, min_size=1))
def test_plain_counters_are_in_order_of_their_values(numbers: list[int]) -> None:
    assert ordered(*(f"{n}_cam-image_array_.jpg" for n in numbers)) == [
        f"{n}_cam-image_array_.jpg" for n in sorted(numbers)
    ]


@given(st.sets(st.text("ab01.é²", min_size=1), min_size=1))
def test_the_order_is_total_for_any_names(names: set[str]) -> None:
    assert ordered(*sorted(names)) == ordered(*sorted(names, reverse=True))
