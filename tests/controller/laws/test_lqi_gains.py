"""Claims about the stored schedules of LQI gains."""

import subprocess
import sys

import pytest
from controller_rig import SETTINGS

from controller.controller import build
from controller.laws.lqi import schedule
from controller.laws.lqi_settings import SPEEDS_MPS, Lags

LQI = SETTINGS.lateral.lqi
LAGS = (Lags(0.05, 0.1, 0.0),) * len(SPEEDS_MPS)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    schedule.cache_clear()
    yield tmp_path / "trepid" / "gains"
    schedule.cache_clear()


def again():
    schedule.cache_clear()
    return schedule(LAGS, LQI)


def test_a_stored_schedule_is_the_computed_one_without_computing(folder, monkeypatch):
    computed = schedule(LAGS, LQI)
    assert len(list(folder.iterdir())) == 1
    monkeypatch.setitem(sys.modules, "controller.laws.lqi_design", None)  # an import of it fails
    assert again() == computed


def test_another_vehicle_or_setting_is_computed_again(folder):
    schedule(LAGS, LQI)
    schedule((Lags(0.06, 0.1, 0.0),) * len(SPEEDS_MPS), LQI)
    schedule(LAGS, LQI.model_copy(update=dict(damping=1.5)))
    assert len(list(folder.iterdir())) == 3


@pytest.mark.parametrize(
    "damage", ["", "{", "[]", "[[1, 2]]", "null", '"text"', "[[0.5, NaN, [1,2,3,4,5], [1,2,3]]]"]
)
def test_a_damaged_file_is_computed_again(folder, damage):
    computed = schedule(LAGS, LQI)
    (file,) = folder.iterdir()
    file.write_text(damage)
    assert again() == computed
    assert file.read_text() != damage


@pytest.mark.parametrize("cache", ["/proc/nowhere", "relative"])
def test_a_folder_that_cannot_be_written_costs_only_the_computation(monkeypatch, tmp_path, cache):
    monkeypatch.setenv("XDG_CACHE_HOME", cache)
    monkeypatch.setenv("HOME", str(tmp_path / "file"))
    (tmp_path / "file").write_text("a file where a folder is needed")
    assert len(again()) == len(SPEEDS_MPS)


def test_a_controller_with_stored_gains_does_not_import_python_control(folder):
    build()  # stores the gains
    assert folder.is_dir()
    import_all = (
        "import sys; from controller.controller import build; build(); print('control' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", import_all], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
