"""Annotated images and the files that they are written to."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_road_rig import look

from cockpit.footage.annotate import WHITE, AnnotationWriter, annotate, text
from cockpit.footage.sources import Clip, sources
from trepid.config import InputError


def test_the_annotation_changes_the_road_and_leaves_the_input_alone(picture):
    before = picture.copy()
    drawn = annotate(picture, look(picture))
    assert (picture == before).all()
    plain = cv2.resize(picture, (640, 480), interpolation=cv2.INTER_CUBIC)
    assert np.abs(drawn[400].astype(int) - plain[400]).max() > 30


def test_the_dark_edge_of_a_text_is_at_its_letters_and_nowhere_else():
    canvas = np.full((60, 640, 3), 128, np.uint8)
    text(canvas, "confidence 0.99 of a long line of words", (10, 40), 0.52, WHITE)
    dark, bright = (canvas < 100).all(axis=2), (canvas > 160).all(axis=2)
    assert dark.sum() > 500 and bright.sum() > 300
    near = cv2.dilate(bright.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    assert not (dark & ~near).any()


def still(writer: AnnotationWriter, image: np.ndarray, source: Path) -> None:
    writer.write(image, source, is_clip=False, fps=25.0)


def test_two_pictures_do_not_fit_into_one_file(picture, tmp_path):
    writer = AnnotationWriter(tmp_path / "one.png", [])
    still(writer, picture, tmp_path / "a.jpg")
    with pytest.raises(InputError, match="one image only"):
        still(writer, picture, tmp_path / "b.jpg")


def test_every_picture_and_every_clip_gets_a_file_of_its_own(picture, tmp_path):
    writer = AnnotationWriter(tmp_path / "out", [])
    for source in ("f.jpg", "f.png", "f_2.png", "x/f.jpg"):
        still(writer, picture, Path(source))
    for source in ("x/clip.mp4", "x/clip.mp4", "y/clip.mp4"):
        writer.write(picture, Path(source), is_clip=True, fps=25.0)
    writer.close()
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"f.png", "f_2.png", "f_2_2.png", "f_3.png", "clip.mp4", "clip_2.mp4"}
    frames = [frames_of(tmp_path / "out" / name) for name in ("clip.mp4", "clip_2.mp4")]
    assert frames == [2, 1]


def frames_of(film: Path) -> int:
    (clip,) = sources(film)
    assert isinstance(clip, Clip)
    return len(list(clip.shots()))


@pytest.mark.parametrize("through", ["the file", "its folder", "a link", "another name"])
def test_an_input_is_never_overwritten(through, picture, tmp_path):
    road = tmp_path / "in" / "road.png"
    road.parent.mkdir()
    cv2.imwrite(str(road), picture)
    before, inputs, out = road.read_bytes(), [road], road
    if through == "its folder":
        inputs, out = [road.parent], road.parent
    elif through == "a link":
        out = tmp_path / "link"
        out.symlink_to(road.parent)
    elif through == "another name":
        out = tmp_path / "other.png"
        out.hardlink_to(road)
    with pytest.raises(InputError, match=r"is an input, which is never overwritten"):
        still(AnnotationWriter(out, inputs), picture, road)
    assert road.read_bytes() == before


def test_a_clip_is_not_replaced_by_its_own_annotated_frames(picture, tmp_path):
    own = tmp_path / "own.mp4"
    own.write_bytes(b"a film")
    with pytest.raises(InputError, match=r"own\.mp4: is an input"):
        AnnotationWriter(own, [own]).write(picture, own, is_clip=True, fps=25.0)
    assert own.read_bytes() == b"a film"


@pytest.mark.parametrize("out", ["road.png/sub", "road.png/sub/a.png", "road.png/sub/a.mp4"])
def test_a_place_that_cannot_be_written_is_named_in_one_line(out, picture, tmp_path):
    (tmp_path / "road.png").write_bytes(b"")
    with pytest.raises(InputError, match=r"road\.png/sub/a\.(png|mp4): cannot be written: ") as problem:
        still(AnnotationWriter(tmp_path / out, []), picture, Path("a.jpg"))
    assert "\n" not in str(problem.value)
