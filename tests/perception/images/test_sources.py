"""Images, folders of images and videos, read from files."""

from pathlib import Path

import pytest

from perception.images.sources import Still, sources
from trepid.config import InputError


def cut(path: Path, share: float) -> Path:
    short = path.with_name(f"cut{path.suffix}")
    data = path.read_bytes()
    short.write_bytes(data[: int(len(data) * share)])
    return short


def bad_inputs(folder: Path, clip: Path) -> dict[str, Path]:
    (folder / "empty").mkdir()
    (folder / "text.jpg").write_text("no image")
    (folder / "zero.png").write_bytes(b"")
    (folder / "notes.txt").write_text("notes")
    (folder / "text.mp4").write_text("no video")
    return {
        "empty folder": folder / "empty",
        "text as image": folder / "text.jpg",
        "empty file": folder / "zero.png",
        "unknown kind": folder / "notes.txt",
        "text as video": folder / "text.mp4",
        "missing": folder / "missing.png",
        "truncated jpeg": cut(folder / "a.jpg", 0.6),
        "truncated png": cut(folder / "b.png", 0.6),
        "truncated video": cut(clip, 0.6),
    }


@pytest.mark.parametrize(
    "kind",
    [
        "empty folder",
        "text as image",
        "empty file",
        "unknown kind",
        "text as video",
        "missing",
        "truncated jpeg",
        "truncated png",
        "truncated video",
    ],
)
def test_bad_input_is_named_in_one_line(kind, folder, clip):
    bad = bad_inputs(folder, clip)[kind]
    with pytest.raises(InputError) as problem:
        for source in sources(bad):
            list(source.read())
    assert str(bad) in str(problem.value) and "\n" not in str(problem.value)


def test_hidden_and_foreign_files_in_a_folder_are_left_out(folder):
    (folder / "readme.txt").write_text("notes")
    found = sources(folder)
    assert all(isinstance(source, Still) for source in found) and len(found) == 2


def test_the_images_of_a_folder_come_in_natural_order(folder):
    for name in ("100.png", "2.png", "frame10.png", "frame9.png"):
        (folder / name).write_bytes((folder / "b.png").read_bytes())
    names = [source.path.name for source in sources(folder)]
    assert names == ["2.png", "100.png", "a.jpg", "b.png", "frame9.png", "frame10.png"]
