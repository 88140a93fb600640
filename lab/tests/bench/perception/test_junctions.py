"""The benchmark of junctions: its shapes, its cases within their ranges, its tables."""

import pytest

from lab.bench.perception.junctions import SHAPES, Passage, scenario_of, summary


@pytest.mark.parametrize("shape", SHAPES)
def test_the_car_passes_the_whole_mouth_of_every_shape_on_its_way(shape):
    for number in range(5):
        scenario = scenario_of(Passage(shape, number, 1))
        (junction,) = scenario.build_road().settings.junctions
        before_m, beyond_m = junction.mouth_m
        assert before_m > 20.0  # the estimators have seen the road before
        assert beyond_m < scenario.distance_m


def test_equal_drives_are_equal_and_others_differ():
    first, again, other = (scenario_of(Passage("crossing without lines", n, 1)) for n in (3, 3, 4))
    assert first == again
    assert first.junctions != other.junctions


def test_a_stop_is_no_departure():
    row = {"shape": "crossing without lines", "largest_offset_m": 0.1, "max_fear": 0.9}
    table = summary([row | {"finished": False, "departures": 0}, row | {"finished": True, "departures": 1}])
    assert table["all drives"]["past"] == 1
    assert table["all drives"]["departures"] == 1
    assert list(table["by shape"]) == ["crossing without lines"]
