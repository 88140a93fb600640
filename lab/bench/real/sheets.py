"""Contact sheets and the reliability diagram as PNG files."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from cockpit.footage.annotate import label
from trepid.images.figure_style import bare, estimator_colours, new_figure, save
from trepid.images.files import write_image

Row = dict[str, Any]
PER_SHEET, ACROSS = 12, 3
BINS = np.linspace(0.0, 1.0, 11)


def evenly(count: int, wanted: int = PER_SHEET) -> list[int]:
    """Up to ``wanted`` indices spread over ``count``."""
    return list(dict.fromkeys(np.linspace(0, count - 1, min(count, wanted)).astype(int).tolist()))


def worst(rows: Sequence[Row], name: str, wrong: Sequence[bool], wanted: int = PER_SHEET) -> list[int]:
    """Indices of the wrong answers of an estimator, the most confident first."""
    indices = [index for index, bad in enumerate(wrong) if bad]
    indices.sort(key=lambda index: -rows[index]["estimates"][name]["confidence"])
    return indices[:wanted]


def sheet(rows: Sequence[Row], indices: Sequence[int], tiles: Path, out: Path) -> None:
    """The frames ``indices``, each with its number, confidences, share of its lane on the label, and fear."""
    if not indices:
        return
    pictures = [cv2.imread(str(tiles / f"{index}.jpg")) for index in indices]
    shown = [picture for picture in pictures if picture is not None]
    height, width = max(one.shape[0] for one in shown), max(one.shape[1] for one in shown)
    canvas = np.full((-(-len(shown) // ACROSS) * height, ACROSS * width, 3), 30, np.uint8)
    for place, (index, picture) in enumerate(zip(indices, shown, strict=True)):
        top, left = place // ACROSS * height, place % ACROSS * width
        tile = np.array(picture, np.uint8)
        label(tile, f"{index} {_words(rows[index])}", (2, 16), 0.4)
        canvas[top : top + tile.shape[0], left : left + tile.shape[1]] = tile
    write_image(out, canvas)


def _words(row: Row) -> str:
    parts = []
    for name, answer in row["estimates"].items():
        inside = f" in {answer['inside']:.2f}" if "inside" in answer else ""
        parts.append(f"{name} {answer['confidence']:.2f}{inside}" if answer["answered"] else f"{name} -")
    return f"{'  '.join(parts)}  fear {row['fear']:.2f}"


def reliability(answers: Mapping[str, Sequence[tuple[float, bool]]], out: Path) -> None:
    """Draw the share of right answers over confidence, from (confidence, right) of the labelled frames."""
    figure = new_figure(5.0, 3.6, layout="constrained")
    panel = figure.subplots()
    panel.plot([0, 1], [0, 1], color="0.7", linewidth=1)
    colours = estimator_colours(list(answers))
    for name, pairs in answers.items():
        if not pairs:
            continue
        confidence, right = np.array(pairs, float).T
        bins = np.clip(np.digitize(confidence, BINS) - 1, 0, len(BINS) - 2)
        inside = [bins == index for index in range(len(BINS) - 1) if (bins == index).any()]
        points = [(float(confidence[these].mean()), float(right[these].mean())) for these in inside]
        panel.plot(*zip(*points, strict=True), "o-", color=colours[name], label=name)
        for point, these in zip(points, inside, strict=True):
            panel.annotate(str(these.sum()), point, fontsize=7, xytext=(3, -9), textcoords="offset points")
    panel.set_xlabel("confidence")
    panel.set_ylabel("share with at least 80 % of the lane on the label")
    panel.legend()
    bare(panel)
    save(figure, out)
