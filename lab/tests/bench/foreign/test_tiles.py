"""The world of floor tiles, on tiles that the test draws: round bends, a dashed yellow middle, white edges."""

import io
import math
import tarfile
from pathlib import Path

import cv2
import numpy as np
import pytest

from lab.bench.foreign import tile_files
from lab.bench.foreign.tile_lane import profile
from lab.bench.foreign.tile_track import read_track
from lab.bench.foreign.tile_world import Tiles
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Command

CAR = CONFIG_DIR / "cars" / "duckiebot"
SIZE, TILE_M = 200, 0.6
EDGE = 0.43  # of a tile, from the yellow line to the white ones
LOOP = """\
tiles:
- [curve_left/W, straight/W, curve_left/N, floor]
- [straight/S, floor, curve_right/W, curve_left/N]
- [curve_left/S, straight/E, straight/E, curve_left/E]
tile_size: 0.6
"""
OVAL = "tiles:\n- [curve_left/W, curve_left/N]\n- [curve_left/S, curve_left/E]\ntile_size: 0.6\n"


def drawn_tile(kind: str) -> np.ndarray:
    image = np.full((SIZE, SIZE, 3), 50, np.uint8)
    lines = ((0.5, (0, 220, 220), 8), (0.5 + EDGE, (255, 255, 255), 16), (0.5 - EDGE, (255, 255, 255), 16))
    for at, colour, width in lines:
        if kind == "straight":
            cv2.line(image, (round(at * SIZE), 0), (round(at * SIZE), SIZE), colour, width)
        elif kind != "floor":
            corner = (0 if kind == "curve_left" else SIZE, SIZE)
            cv2.circle(image, corner, round(at * SIZE), colour, width, cv2.LINE_AA)
    if kind == "straight":
        image[::20], image[1::20], image[2::20] = 50, 50, 50  # gaps of the dashes
    return image


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiles")
    (folder / "maps").mkdir()
    (folder / "maps" / "loop.yaml").write_text(LOOP)
    (folder / "maps" / "oval.yaml").write_text(OVAL)
    (folder / "maps" / "crossing.yaml").write_text("tiles:\n- [4way, floor]\ntile_size: 0.6\n")
    (folder / "maps" / "open.yaml").write_text("tiles:\n- [curve_left/N, straight/N]\ntile_size: 0.6\n")
    for kind in ("straight", "curve_left", "curve_right", "floor"):
        path = folder / "textures" / "tiles-processed" / "drawn" / kind / "texture.jpg"
        path.parent.mkdir(parents=True)
        cv2.imwrite(str(path), drawn_tile(kind), [cv2.IMWRITE_JPEG_QUALITY, 98])
    return folder


@pytest.fixture(scope="module")
def world(files: Path) -> Tiles:
    camera, vehicle = load(CAR / "camera.yaml", Camera), load(CAR / "vehicle.yaml", Vehicle)
    return Tiles(camera, vehicle, seed=1, map="loop", look="drawn", files=str(files))


@pytest.mark.parametrize(("name", "lefts", "rights"), [("oval", 4, 0), ("loop", 5, 1)])
def test_a_map_closes_and_a_lap_turns_once_to_the_left(
    name: str, lefts: int, rights: int, files: Path
) -> None:
    track = read_track(files / "maps" / f"{name}.yaml", files / "textures" / "tiles-processed" / "drawn")
    turns = [piece.turn for piece in track.pieces]
    assert (turns.count(1), turns.count(-1)) == (lefts, rights)
    assert sum(piece.length_m * piece.curvature_1pm for piece in track.pieces) == pytest.approx(math.tau)
    for piece, after in zip(track.pieces, (*track.pieces[1:], track.pieces[0]), strict=True):
        turned_rad = piece.length_m * piece.curvature_1pm
        chord_m = 2 / piece.curvature_1pm * math.sin(turned_rad / 2) if turned_rad else piece.length_m
        end = complex(piece.x_m, piece.y_m) + chord_m * np.exp(1j * (piece.yaw_rad + turned_rad / 2))
        assert abs(end - complex(after.x_m, after.y_m)) < 1e-9


@pytest.mark.parametrize(
    ("kind", "reverse", "turn", "middle"),
    [
        ("straight", False, 0, 0.5 + EDGE / 2),
        ("straight", True, 0, 0.5 + EDGE / 2),
        ("curve_left", False, 1, 0.5 + EDGE / 2),
        ("curve_left", True, -1, 0.5 - EDGE / 2),
        ("curve_right", False, -1, 0.5 - EDGE / 2),
        ("curve_right", True, 1, 0.5 + EDGE / 2),
    ],
)
def test_the_lane_of_a_tile_is_where_its_lines_are_drawn(
    kind: str, reverse: bool, turn: int, middle: float, files: Path
) -> None:
    path = files / "textures" / "tiles-processed" / "drawn" / kind / "texture.jpg"
    found = profile(path, reverse=reverse, turn=turn)
    assert found.middle == pytest.approx(middle, abs=0.012)
    assert found.width == pytest.approx(EDGE, abs=0.02)


def test_the_car_begins_in_the_middle_and_its_picture_is_the_same_for_the_same_seed(
    files: Path, world: Tiles
) -> None:
    camera, vehicle = load(CAR / "camera.yaml", Camera), load(CAR / "vehicle.yaml", Vehicle)
    first, again = (
        Tiles(camera, vehicle, seed=4, map="loop", look="drawn", files=str(files)) for _ in range(2)
    )
    state = first.state()
    assert abs(state.lateral_offset_m) < 0.005 and abs(state.heading_error_rad) < 0.02
    assert state.lane_width_m == pytest.approx(EDGE * TILE_M, abs=0.01)
    assert (first.picture() == again.picture()).all()


def test_a_car_that_turns_as_its_lane_does_comes_round_and_counts_its_way(files: Path) -> None:
    camera, vehicle = load(CAR / "camera.yaml", Camera), load(CAR / "vehicle.yaml", Vehicle)
    world = Tiles(camera, vehicle, seed=1, map="loop", look="drawn", files=str(files))
    way_m = world.track.length_m
    worst_m = 0.0
    for number in range(4000):
        state = world.state()
        worst_m = max(worst_m, abs(state.lateral_offset_m))
        if state.station_m - way_m > 0.6:
            break
        turn_1pm = world.curvature_at(0.02) - 40.0 * state.lateral_offset_m - 9.0 * state.heading_error_rad
        accel_mps2 = 1.0 if number < 25 else 0.0
        angle_rad = math.atan(vehicle.wheelbase_m * turn_1pm)
        world.advance(
            Command(t_s=0.0, road_wheel_angle_rad=angle_rad, speed_mps=0.25, accel_mps2=accel_mps2), 0.01
        )
    assert state.station_m > way_m and worst_m < 0.04
    world.recentre()
    assert abs(world.state().lateral_offset_m) < 0.005


def test_the_picture_shows_the_white_edge_where_the_lane_ends(world: Tiles) -> None:
    camera, state = load(CAR / "camera.yaml", Camera), world.state()
    right = [[0.35, -state.lane_width_m / 2]]
    u, v = camera.pixel_from_road(right)[0]
    patch = world.picture()[round(v) - 1 : round(v) + 2, round(u) - 2 : round(u) + 3]
    assert patch.mean() > 110  # the floor is 50 at most


@pytest.mark.parametrize(
    ("name", "text"),
    [("crossing", "has junctions"), ("open", "the road does not close: 'nothing' at column -1")],
)
def test_a_map_that_is_no_closed_track_is_refused(name: str, text: str, files: Path) -> None:
    with pytest.raises(InputError, match=text):
        read_track(files / "maps" / f"{name}.yaml", files)


def test_maps_and_tiles_alone_are_taken_out_of_the_package(tmp_path: Path) -> None:
    names = ("maps/a.yaml", "textures/tiles-processed/photos/x.jpg", "meshes/b.obj", "maps/../../c.yaml")
    with tarfile.open(tmp_path / "p.tar.gz", "w:gz") as packed:
        for name in names:
            member = tarfile.TarInfo("p-1" + tile_files.INSIDE + name)
            member.size = 3
            packed.addfile(member, io.BytesIO(b"abc"))
    tile_files.take_out(tmp_path / "p.tar.gz", tmp_path / "out")
    found = {
        path.relative_to(tmp_path / "out").as_posix()
        for path in (tmp_path / "out").rglob("*")
        if path.is_file()
    }
    assert found == {*names[:2], tile_files.DONE}
    assert not (tmp_path / "c.yaml").exists()


def test_without_the_package_index_the_reason_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(tile_files.sys, "executable", "/bin/false")
    with pytest.raises(
        InputError, match=r"duckietown-world-daffy==6\.4\.3 cannot be had: is the package index"
    ):
        tile_files.tile_files()
