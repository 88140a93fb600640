"""Annotated images and the files that they are written to."""

import cv2
import numpy as np
import pytest
from drawn_road_rig import look

from perception.images.annotate import WHITE, AnnotationWriter, annotated, text
from trepid.config import InputError


def test_the_annotation_changes_the_road_and_leaves_the_input_alone(picture):
    before = picture.copy()
    drawn = annotated(picture, look(picture))
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


def test_two_pictures_do_not_fit_into_one_file(picture, tmp_path):
    writer = AnnotationWriter(tmp_path / "one.png", fps=25.0)
    writer.write(picture, tmp_path / "a.jpg", is_clip=False)
    with pytest.raises(InputError, match="one image only"):
        writer.write(picture, tmp_path / "b.jpg", is_clip=False)
