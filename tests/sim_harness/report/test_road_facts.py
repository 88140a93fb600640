"""``trepid sim road show``: facts and pictures of roads, and one line with a place for a bad road file."""

import json

import cv2
import pytest
from typer.testing import CliRunner

import sim_harness.report.road_cli
from sim_harness.report.road_facts import facts
from sim_harness.report.road_picture import stations_along
from sim_harness.world.road_file import load_road
from trepid.config import CONFIG_DIR, InputError

TOWN = (CONFIG_DIR / "roads" / "town.yaml").read_text()


def show(*arguments: object):
    return CliRunner().invoke(
        sim_harness.report.road_cli.app, ["show", *map(str, arguments)], catch_exceptions=True
    )


def test_the_example_of_the_documentation_is_a_road(tmp_path):
    text = (CONFIG_DIR.parent / "docs" / "roads.md").read_text()
    (tmp_path / "example.yaml").write_text(text.split("```yaml\n")[1].split("```")[0])
    road = load_road(tmp_path / "example.yaml")
    assert (road.length_m, len(road.settings.marks)) == (135.0, 2)


def test_facts_of_a_road():
    row = facts(load_road("dual_carriageway"))
    assert row["length_m"] == 1400.0 and row["min_radius_m"] == 400.0
    assert (row["lanes_left"], row["lanes_right"]) == (2, 1)
    assert facts(load_road("gravel_track"))["lane_width_m"] == [2.7, 3.6]
    assert facts(load_road("straight"))["min_radius_m"] is None


def test_json_has_one_line_for_each_road():
    result = show("town", "bridge", "--json")
    assert [json.loads(line)["name"] for line in result.output.splitlines()] == ["town", "bridge"]


def test_a_picture_has_a_view_of_every_place(tmp_path):
    assert show("town", "--at", "100", "--at", "190", "--picture", tmp_path / "town.png").exit_code == 0
    picture = cv2.imread(str(tmp_path / "town.png"))
    assert picture.shape[1] == 2 * 240 + 4
    assert picture.std() > 20
    places = stations_along(load_road("town"), 6)
    assert len(places) == 6 and all(0 <= s < 420 for s in places)


def test_a_picture_that_cannot_be_written_is_refused(tmp_path):
    for path in (tmp_path / "missing" / "town.png", tmp_path / "town.xyz"):
        result = show("town", "--at", 5, "--picture", path)
        assert isinstance(result.exception, InputError) and str(path) in str(result.exception)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("left_lanes: [{}]", "left_lanes: [{width: 3}]", 19, "unknown field 'sections.0.left_lanes.0.width'"),
        ("kind: zebra", "kind: zebras", None, "marks.4.kind"),
        ("kind: zebra, at_m: 200", "kind: zebra", None, "'marks.4.at_m' is missing"),
        ("at_m: 350", "at_m: 3500", 73, "beyond the road's 420.0 m"),
        ("start_m: 260", "start_m: 900", 50, "starts beyond the end at 420.0 m"),
        ("[0, 0.025]", "[0, 0.02]", 9, "jumps from 0.02 to 0.025 1/m"),
        ("side: both", "side: up", None, "junctions.0.side"),
        ("gap_m: 3}", "gap_m: 3, gaps_m: [[5, 4]]}", None, "a gap must end beyond its start"),
        ("lane: 1}", "lane: 4}", 62, "has no lane 4"),
        ("kerb_m: 0.25", "kerb_m: 9", 23, "sections.0.kerb_m"),
        ("damage: 0.4", "damage: 40", None, "sections.3.left.damage"),
        ('text: "30", at_m: 24', "at_m: 24", None, "text is required for a mark of kind text"),
    ],
)
def test_a_bad_road_file_is_refused_with_its_place(tmp_path, old, new, line, message):
    path = tmp_path / "bad.yaml"
    assert old in TOWN
    path.write_text(TOWN.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"bad.yaml:{line or '[0-9]+'}:[0-9]+: ") as refused:
        load_road(path)
    assert message in str(refused.value) and "\n" not in str(refused.value)
