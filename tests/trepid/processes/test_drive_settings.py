"""The settings of a drive."""

from pathlib import Path

import pytest

from trepid.config import CAR, CONFIG_DIR, InputError, load
from trepid.processes.drive_settings import DriveSettings


@pytest.mark.parametrize("name", ["", "a/b", "/x", "a*b", "a?b", "a#b", "my car", ".", "-x"])
def test_a_name_of_the_vehicle_that_is_no_part_of_a_topic_is_refused_with_its_place(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(tmp_path))
    (tmp_path / "drive.yaml").write_text(f'vehicle_name: "{name}"\n')
    with pytest.raises(InputError, match=r"drive\.yaml:1:1: vehicle_name: "):
        load(CONFIG_DIR / "drive.yaml", DriveSettings)


@pytest.mark.parametrize("name", ["rc-car", "shuttle_2", "7.b", "größe"])
def test_letters_digits_and_three_signs_make_a_name(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(tmp_path))
    (tmp_path / "drive.yaml").write_text(f'vehicle_name: "{name}"\n', encoding="utf-8")
    assert load(CONFIG_DIR / "drive.yaml", DriveSettings).vehicle_name == name
