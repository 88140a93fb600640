import pytest

from perception.lane.settings import LaneCvSettings
from trepid.config import CONFIG_DIR, InputError, load


def config_with(tmp_path, *, added: str = "", removed: tuple[str, ...] = ()):
    lines = (CONFIG_DIR / "perception.yaml").read_text().splitlines()
    kept = [line for line in lines if not line.startswith(tuple(f"{name}:" for name in removed))]
    path = tmp_path / "perception.yaml"
    path.write_text("\n".join([added, *kept]))
    return path


@pytest.mark.parametrize(("former", "names"), LaneCvSettings.former_names.items())
def test_a_former_name_of_a_limit_sets_the_fields_of_today_with_a_warning(former, names, tmp_path, capsys):
    path = config_with(tmp_path, added=f"{former}: 0.42", removed=names)
    settings = load(path, LaneCvSettings)
    assert [getattr(settings, name) for name in names] == [0.42] * len(names)
    warning = capsys.readouterr().err
    assert all(name in warning for name in (former, *names))


def test_the_shipped_file_has_no_former_names(capsys):
    load(CONFIG_DIR / "perception.yaml", LaneCvSettings)
    assert capsys.readouterr().err == ""


def test_an_unknown_limit_is_refused_with_its_place(tmp_path):
    with pytest.raises(InputError, match=r"perception\.yaml:1:1: unknown field 'enuf_score'.*enough_score"):
        load(config_with(tmp_path, added="enuf_score: 0.3"), LaneCvSettings)
