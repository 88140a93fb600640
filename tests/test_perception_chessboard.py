"""A camera is found again from drawn pictures of a chessboard; too few or too similar ones are refused."""

import cv2
import numpy as np
import pytest

from perception.chessboard import intrinsics
from trepid.config import InputError

CORNERS = (7, 5)
SIZE_PX = (480, 360)
MATRIX = np.array([[430.0, 0, 251.0], [0, 424.0, 172.0], [0, 0, 1]])
DISTORTION = np.array([-0.22, 0.06, 0.0, 0.0, 0.0])
FINER = 2
POSES = [
    ((0.0, 0.0, 0.0), (-3.5, -2.5, 9.0)),
    ((0.5, 0.0, 0.1), (-5.5, -3.5, 10.0)),
    ((-0.5, 0.1, 0.0), (-2.0, -2.0, 11.0)),
    ((0.0, 0.5, -0.1), (-5.5, -1.0, 10.0)),
    ((0.0, -0.5, 0.2), (-1.5, -1.0, 11.0)),
    ((0.3, 0.4, 0.5), (-2.5, -3.0, 11.0)),
    ((-0.4, -0.3, -0.4), (-4.0, -1.5, 12.0)),
    ((0.2, -0.4, 1.3), (1.5, -3.5, 11.0)),
]


def drawn(turn: tuple[float, float, float], place: tuple[float, float, float]) -> np.ndarray:
    """The board at a pose, seen through the lens: every pixel, twice finer, looks up its square."""
    width, height = SIZE_PX
    u, v = np.meshgrid(np.arange(FINER * width), np.arange(FINER * height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1) / FINER - (1 - 1 / FINER) / 2
    rays = cv2.undistortPoints(pixels[:, None, :], MATRIX, DISTORTION)[:, 0]
    rotation, _ = cv2.Rodrigues(np.array(turn))
    homography = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(place)])
    x, y, w = np.linalg.solve(homography, np.column_stack([rays, np.ones(len(rays))]).T)
    x, y = x / w + 1, y / w + 1  # the first inner corner is (1, 1) squares from the border of the pattern
    columns, rows = CORNERS[0] + 1, CORNERS[1] + 1
    on = (x > 0) & (x < columns) & (y > 0) & (y < rows)
    dark = on & ((np.floor(x) + np.floor(y)) % 2 == 0)
    fine = np.where(dark, 30, 225).astype(np.uint8).reshape(FINER * height, FINER * width)
    return cv2.cvtColor(cv2.resize(fine, SIZE_PX, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)


@pytest.fixture(scope="module")
def boards() -> dict[str, np.ndarray]:
    return {f"{number}.png": drawn(*pose) for number, pose in enumerate(POSES)}


def test_focal_length_centre_and_distortion_are_found_again(boards: dict[str, np.ndarray]) -> None:
    found = intrinsics(boards, CORNERS)
    assert found.reprojection_px < 0.1
    assert found.matrix[[0, 1], [0, 1]] == pytest.approx([430.0, 424.0], rel=2e-3)
    assert found.matrix[:2, 2] == pytest.approx([251.0, 172.0], abs=1.0)
    rays = np.array([[x, y, 1.0] for x in (-0.5, 0.0, 0.5) for y in (-0.35, 0.0, 0.35)])
    zero = np.zeros(3)
    wanted = cv2.projectPoints(rays, zero, zero, MATRIX, DISTORTION)[0]
    seen = cv2.projectPoints(rays, zero, zero, found.matrix, np.array(found.distortion))[0]
    assert np.abs(seen - wanted).max() < 0.5


def test_a_picture_without_a_board_and_one_of_another_size_are_left_out_with_the_reason(
    boards: dict[str, np.ndarray],
) -> None:
    more = {
        **boards,
        "road.png": np.full((360, 480, 3), 90, np.uint8),
        "big.png": np.zeros((400, 480, 3), np.uint8),
    }
    found = intrinsics(more, CORNERS)
    assert found.boards == tuple(boards)
    assert found.left_out == {
        "road.png": "no board of 7 x 5 inner corners",
        "big.png": "of 480 x 400 px, the others of 480 x 360",
    }


def test_a_board_that_was_bent_is_left_out(boards: dict[str, np.ndarray]) -> None:
    rows, columns = np.indices(boards["0.png"].shape[:2], np.float32)
    wavy = cv2.remap(
        boards["0.png"], columns, rows + 4 * np.sin(columns / 60).astype(np.float32), cv2.INTER_LINEAR
    )
    found = intrinsics({**boards, "wavy.png": wavy}, CORNERS)
    assert "px off" in found.left_out["wavy.png"]
    assert found.matrix[0, 0] == pytest.approx(430.0, rel=2e-3)


def test_too_few_boards_are_refused(boards: dict[str, np.ndarray]) -> None:
    few = dict(list(boards.items())[:5])
    with pytest.raises(InputError, match=r"5 usable pictures .* 6 expected"):
        intrinsics(few, CORNERS)


def test_boards_that_are_all_alike_are_refused(boards: dict[str, np.ndarray]) -> None:
    alike = {f"{number}.png": boards["0.png"] for number in range(8)}
    with pytest.raises(InputError, match=r"too alike: tilted by 0\.0° at most"):
        intrinsics(alike, CORNERS)
