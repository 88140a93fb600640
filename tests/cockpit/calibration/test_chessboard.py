"""Calibration of a lens from drawn images of a chessboard."""

import cv2
import numpy as np
import pytest
from chessboard_rig import CORNERS, DISTORTION, MATRIX, POSES, draw_board

from cockpit.calibration.chessboard import intrinsics
from trepid.config import InputError


@pytest.fixture(scope="module")
def boards() -> dict[str, np.ndarray]:
    return {f"{number}.png": draw_board(*pose) for number, pose in enumerate(POSES)}


def test_focal_length_centre_and_distortion_are_recovered(boards: dict[str, np.ndarray]) -> None:
    found = intrinsics(boards, CORNERS)
    assert found.reprojection_px < 0.1
    assert found.matrix[[0, 1], [0, 1]] == pytest.approx([430.0, 424.0], rel=2e-3)
    assert found.matrix[:2, 2] == pytest.approx([251.0, 172.0], abs=1.0)
    rays = np.array([[x, y, 1.0] for x in (-0.5, 0.0, 0.5) for y in (-0.35, 0.0, 0.35)])
    zero = np.zeros(3)
    wanted = cv2.projectPoints(rays, zero, zero, MATRIX, DISTORTION)[0]
    seen = cv2.projectPoints(rays, zero, zero, found.matrix, np.array(found.distortion))[0]
    assert np.abs(seen - wanted).max() < 0.5


def test_images_without_a_board_or_of_another_size_are_left_out_with_the_reason(
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


def test_a_bent_board_is_left_out(boards: dict[str, np.ndarray]) -> None:
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
