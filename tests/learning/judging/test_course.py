"""The picture of ``trepid evaluate``: angles over the time of driving, and prediction against record."""

import numpy as np
import pytest

from learning.judging.course import MOST_STRIPS, as_image, course_figure, driving_time_s

PERIOD_S = 0.05


def rows_of(*pieces: int, pause_s: float = 30.0) -> np.ndarray:
    """Rows of one route at 20 Hz, in pieces of so many frames with a pause and a missing frame between them."""
    kinds = [("route", "<U8"), ("stretch", "<i4"), ("frame", "<i8"), ("t_s", "<f8")]
    rows, frame, t_s = [], 0, 1000.0
    for stretch, count in enumerate(pieces):
        for _ in range(count):
            rows.append(("a", stretch, frame, t_s))
            frame, t_s = frame + 1, t_s + PERIOD_S
        frame, t_s = frame + 1, t_s + pause_s
    return np.array(rows, dtype=kinds)


def draw(rows, true_deg, predicted_deg, **options):
    return course_figure(rows, true_deg, predicted_deg, np.full(len(rows), np.nan), **options)


def line(axes, label):
    return next(one for one in axes.lines if one.get_label() == label)


def test_the_time_of_driving_has_no_pauses_and_is_exact_without_any():
    whole = rows_of(40)
    assert driving_time_s(whole) == pytest.approx(whole["t_s"] - whole["t_s"][0])
    assert driving_time_s(rows_of(15, 10, 15)) == pytest.approx(PERIOD_S * np.arange(40))
    assert driving_time_s(rows_of(1)) == [0.0]


def test_the_lines_are_record_and_prediction_and_end_where_a_piece_ends():
    rows = rows_of(20, 20)
    true_deg = np.sin(np.arange(40) / 5)
    axes = draw(rows, true_deg, 0.5 * true_deg).axes[0]
    for label, factor in (("recorded", 1.0), ("predicted", 0.5)):
        shown = np.asarray(line(axes, label).get_ydata(), float)
        assert np.flatnonzero(np.isnan(shown)).tolist() == [20]
        assert np.delete(shown, 20) == pytest.approx(factor * true_deg)


def test_frames_without_a_prediction_are_gaps_and_not_zeros():
    true_deg, predicted_deg = np.ones(30), np.ones(30)
    predicted_deg[10:15] = np.nan
    figure = draw(rows_of(30), true_deg, predicted_deg)
    assert np.isnan(np.asarray(line(figure.axes[0], "predicted").get_ydata(), float)[10:15]).all()
    points = np.column_stack(figure.axes[-1].lines[1].get_data())
    assert np.isfinite(points).all(axis=1).sum() == 25


def test_a_perfect_model_lies_on_the_line_of_equal_angles_of_a_square_scatter():
    true_deg = np.linspace(-7.0, 20.0, 60)
    scatter = draw(rows_of(60), true_deg, true_deg).axes[-1]
    equal, points = scatter.lines[0].get_data(), scatter.lines[1].get_data()
    assert np.array_equal(*equal) and np.array_equal(*points)
    assert scatter.get_xlim() == scatter.get_ylim() and scatter.get_xlim()[1] > 20.0


@pytest.mark.parametrize(("frames", "strips"), [(200, 1), (2400, 3), (40_000, MOST_STRIPS)])
def test_the_strips_of_a_long_drive_share_its_time_without_gap_or_overlap(frames, strips):
    rows = rows_of(frames)
    axes = draw(rows, np.zeros(frames), np.zeros(frames)).axes[:-1]
    assert len(axes) == strips
    limits = [one.get_xlim() for one in axes]
    assert [end for _, end in limits[:-1]] == pytest.approx([start for start, _ in limits[1:]])
    assert limits[0][0] == 0.0 and limits[-1][1] == pytest.approx(driving_time_s(rows)[-1])


def test_the_worst_frames_have_their_rank_in_both_drawings():
    figure = draw(rows_of(50), np.zeros(50), np.arange(50.0), worst=[49, 20])
    for axes in figure.axes:
        assert {text.get_text() for text in axes.texts} >= {"1", "2"}


def test_a_drawing_has_the_asked_width():
    image = as_image(draw(rows_of(50), np.zeros(50), np.ones(50)), 1280)
    assert image.shape[1:] == (1280, 3) and image.dtype == np.uint8
