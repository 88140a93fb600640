"""Settings of disturbances: their stretch, their grades, their changes to the road."""

import json
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from sim_harness.cli import app
from sim_harness.report.disturbance_sheet import disturbances_verb
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.disturbance_table import DisturbanceTable, at, load_table
from sim_harness.world.roads.disturbances import RAMP_M, Disturbance, DisturbanceKind, disturb, grades_at
from sim_harness.world.roads.road import Road, RoadSettings
from trepid.config import InputError

CIRCUIT = load_road("circuit").settings
KINDS = st.sampled_from(list(DisturbanceKind))


def test_a_grade_rises_and_falls_over_the_ramp():
    fog = Disturbance(kind="fog", grade=4, from_m=100, to_m=200)
    stations = (99, 100, 100 + RAMP_M / 2, 100 + RAMP_M, 150, 200 - RAMP_M / 4, 200, 201)
    assert [fog.grade_at(s) for s in stations] == [0, 0, 2, 4, 4, 1, 0, 0]


def test_a_disturbance_of_the_whole_road_has_no_ramp():
    fog = Disturbance(kind="fog", grade=4)
    assert {fog.grade_at(s) for s in (-5.0, 0.0, 1.0, 1e4)} == {4}


def test_of_two_disturbances_of_a_kind_the_higher_grade_applies():
    fogs = [Disturbance(kind="fog", grade=grade) for grade in (2, 4, 3)]
    assert grades_at(fogs, 10.0) == {DisturbanceKind.FOG: 4}


@pytest.mark.parametrize(
    "wrong", [{"grade": 5.1}, {"grade": -1}, {"kind": "mist"}, {"from_m": 20, "to_m": 20}]
)
def test_invalid_settings_are_refused(wrong):
    with pytest.raises(ValidationError):
        Disturbance.model_validate({"kind": "fog", "grade": 1} | wrong)


def test_every_kind_has_an_entry_in_the_table():
    assert set(DisturbanceTable.model_fields) == {str(kind) for kind in DisturbanceKind}


def test_quantities_are_linear_between_the_grades():
    stops = load_table().over_exposure.stops
    assert at(stops, 2.5) == pytest.approx((stops[2] + stops[3]) / 2)
    assert [at(stops, g) for g in range(6)] == list(stops)


@settings(max_examples=25, deadline=None)
@given(KINDS, st.floats(0.1, 5), st.floats(0, 900), st.floats(5, 400))
def test_painting_a_disturbance_is_idempotent_and_gives_a_valid_road(kind, grade, from_m, run_m):
    disturbance = Disturbance(kind=kind, grade=grade, from_m=from_m, to_m=from_m + run_m)
    once = disturb(CIRCUIT, [disturbance])
    assert disturb(once, [disturbance]) == once
    assert RoadSettings.model_validate({**dict(once)}) == once


def test_grade_0_and_kinds_in_the_air_leave_the_road_unchanged():
    assert disturb(CIRCUIT, [Disturbance(kind=kind, grade=0) for kind in DisturbanceKind]) == CIRCUIT
    assert (
        disturb(CIRCUIT, [Disturbance(kind=kind, grade=5) for kind in ("fog", "night", "noise")]) == CIRCUIT
    )


@pytest.mark.parametrize(
    ("kind", "field"),
    [
        ("tree_shadows", "shadows"),
        ("building_shadows", "building_shadows"),
        ("bridge_shadows", "bridge_shadows"),
        ("rain", "wet"),
        ("wet_road", "wet"),
        ("snow", "snow_cover"),
    ],
)
def test_kinds_on_the_ground_are_painted_in_their_stretch_and_grow_with_the_grade(kind, field):
    shares = []
    for grade in range(1, 6):
        road = Road(disturb(CIRCUIT, [Disturbance(kind=kind, grade=grade, from_m=60, to_m=120)]))
        inside, before, behind = (getattr(road.section_at(s), field) for s in (90.0, 40.0, 180.0))
        assert (before, behind) == (0, 0)
        shares.append(inside)
    assert shares[0] > 0 and all(b >= a for a, b in pairwise(shares))


def test_a_split_section_keeps_its_name_its_dashes_and_its_widths():
    section = CIRCUIT.sections[0].model_copy(update={"lane_width_m": (3.4, 3.0), "start_m": 0})
    road = CIRCUIT.model_copy(update={"sections": (section,)})
    parted = disturb(road, [Disturbance(kind="wet_road", grade=3, from_m=300, to_m=500)])
    assert {part.name for part in parted.sections} == {section.name} and len(parted.sections) == 3
    period_m = section.left.dash_m + section.left.gap_m
    assert all(part.start_m % period_m == pytest.approx(0, abs=1e-9) for part in parted.sections)
    stations = np.linspace(1, Road(road).length_m - 1, 50)
    assert [Road(parted).width_at(s) for s in stations] == pytest.approx(
        [Road(road).width_at(s) for s in stations]
    )


def test_the_verb_prints_the_table_and_refuses_a_picture_without_a_folder(capsys, tmp_path):
    assert disturbances_verb(as_json=True) == 0
    assert json.loads(capsys.readouterr().out)["fog"]["visibility_m"][5] == load_table().fog.visibility_m[5]
    with pytest.raises(InputError, match="there is no folder"):
        disturbances_verb(tmp_path / "no" / "sheet.png")


def test_the_verb_is_mounted():
    assert "disturbances" in [command.name for command in app.registered_commands]
