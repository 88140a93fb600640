"""`trepid keys create`: private keys are private, nothing is overwritten, wrong keys are named with the remedy."""

import shutil
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID

from trepid.cli import main
from trepid.config import InputError
from trepid.security import Security, certificate, load_security, private_key
from vehicle.certificates import check_certificate, create
from vehicle.keys_check import check_keys


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.fixture
def keys(tmp_path: Path) -> Path:
    create(tmp_path / "keys", ["launcher", "controller"])
    return tmp_path / "keys"


def secured_settings(folder: Path) -> Security:
    return load_security().model_copy(update={"keys": folder})


def test_private_keys_are_readable_by_their_owner_only(keys: Path) -> None:
    modes = {path.name: stat.S_IMODE(path.stat().st_mode) for path in keys.glob("*.key")}
    assert modes == dict.fromkeys(("ca.key", "launcher.key", "controller.key"), 0o600)


def test_existing_files_are_kept_and_missing_processes_are_added(keys: Path) -> None:
    before = contents(keys)
    made = create(keys, ["launcher", "controller", "mine"])
    assert [path.name for path in made] == ["mine.key", "mine.crt"]
    assert before.items() < contents(keys).items()
    assert create(keys, ["mine"]) == []


def test_a_certificate_is_for_both_sides_of_a_link_and_for_no_further_authority(keys: Path) -> None:
    own = x509.load_pem_x509_certificate(certificate(keys, "controller").read_bytes())
    purposes = own.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
    assert set(purposes) == {ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH}
    assert not own.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    check_certificate(keys, "controller")


def test_half_a_pair_is_refused(keys: Path) -> None:
    private_key(keys, "controller").unlink()
    with pytest.raises(InputError, match=r"controller.crt: controller.key beside it is missing"):
        create(keys, ["controller"])


def test_without_the_key_of_the_authority_nothing_is_added(keys: Path) -> None:
    private_key(keys, "ca").unlink()
    assert create(keys, ["controller"]) == []
    with pytest.raises(InputError, match=r"ca.key: no private key can be read"):
        create(keys, ["mine"])


def test_a_key_that_others_may_read_is_refused_with_the_remedy(keys: Path) -> None:
    for role in ("controller", "ca"):
        private_key(keys, role).chmod(0o644)
        with pytest.raises(InputError, match=rf"mode 0644\); run `chmod 600 .*{role}.key`"):
            check_keys(["controller"], secured_settings(keys))
        private_key(keys, role).chmod(0o600)
    private_key(keys, "ca").unlink()  # as SECURITY.md advises
    check_keys(["controller"], secured_settings(keys))


def test_a_missing_process_is_named_with_the_remedy(keys: Path) -> None:
    with pytest.raises(InputError, match=r"mine.crt: no such file; `trepid keys create .* --process mine`"):
        check_keys(["mine"], secured_settings(keys))


def test_keys_of_another_authority_of_another_process_and_expired_ones_are_refused(
    keys: Path, tmp_path: Path
) -> None:
    create(tmp_path / "foreign", ["controller"])
    for name in ("controller.key", "controller.crt"):
        shutil.copy(tmp_path / "foreign" / name, keys / name)
    with pytest.raises(InputError, match=r"the authority ca.crt beside it did not sign it"):
        check_keys(["controller"], secured_settings(keys))
    for kind in ("key", "crt"):
        shutil.copy(keys / f"launcher.{kind}", keys / f"controller.{kind}")
    with pytest.raises(InputError, match="its common name is not controller"):
        check_keys(["controller"], secured_settings(keys))
    shutil.copy(tmp_path / "foreign" / "controller.key", keys / "launcher.key")
    with pytest.raises(InputError, match=r"is not the certificate of launcher.key"):
        check_certificate(keys, "launcher")


def test_an_expired_certificate_is_refused(keys: Path) -> None:
    with pytest.raises(InputError, match="expired on"):
        check_certificate(keys, "controller", now=datetime.now(UTC) + timedelta(days=1000))


def test_keys_that_are_not_for_the_host_of_the_drive_are_refused_before_it_with_the_remedy(
    keys: Path, tmp_path: Path
) -> None:
    create(tmp_path / "several", ["launcher", "controller"], ["10.0.0.5", "fe80::5", "Car.local"])
    for listen in ("127.0.0.2:7447", "10.0.0.5:7447", "[fe80::5]:7447", "car.local:7447"):
        host = listen.rpartition(":")[0].strip("[]")
        at = {"listen": listen}
        with pytest.raises(InputError, match=rf"launcher.crt: is not for {host}, .*keys --host {host}`"):
            check_keys(["controller"], secured_settings(keys).model_copy(update=at))
        if host != "127.0.0.2":
            check_keys(["controller"], secured_settings(tmp_path / "several").model_copy(update=at))
    check_keys(["controller"], secured_settings(keys).model_copy(update={"listen": "[::1]:7447"}))


def test_a_host_that_existing_certificates_do_not_name_is_refused_and_nothing_is_made(keys: Path) -> None:
    before = contents(keys)
    with pytest.raises(
        InputError, match=r"launcher.crt, controller.crt: exist and are not for --host 10.0.0.5"
    ):
        create(keys, ["launcher", "controller", "mine"], ["10.0.0.5"])
    assert contents(keys) == before


def test_a_machine_whose_clock_is_before_the_certificates_is_told_to_set_it(keys: Path) -> None:
    with pytest.raises(
        InputError, match=r"is not valid before .*, and this machine has 1970-01-02: set its clock"
    ):
        check_certificate(keys, "controller", now=datetime(1970, 1, 2, tzinfo=UTC))


def test_no_certificate_is_valid_for_longer_than_its_authority(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vehicle.certificates.AUTHORITY_DAYS", 300)
    create(tmp_path, ["controller"])
    ends = [
        x509.load_pem_x509_certificate(certificate(tmp_path, role).read_bytes()).not_valid_after_utc
        for role in ("ca", "controller")
    ]
    assert ends[0] == ends[1]
    with pytest.raises(InputError, match=r"ca.crt: expired on .*; remove all .key and .crt files"):
        check_certificate(tmp_path, "controller", now=ends[0] + timedelta(seconds=1))


def test_an_expired_authority_signs_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vehicle.certificates.AUTHORITY_DAYS", -0.5)
    with pytest.raises(InputError, match=r"ca.crt: expired on"):
        create(tmp_path, ["controller"])
    assert not certificate(tmp_path, "controller").exists()


@pytest.mark.parametrize("name", ["../controller", "ca", "", "a b", "p" * 65])
def test_a_name_that_is_no_file_name_or_too_long_is_refused_and_nothing_is_made(
    name: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="cannot name a process"):
        create(tmp_path / "keys", ["launcher", name])
    assert not (tmp_path / "keys").exists()


@pytest.mark.parametrize("name", ["x" * 70, "ü" * 40])
def test_a_folder_may_have_a_long_name(name: str, tmp_path: Path) -> None:
    create(tmp_path / name, ["p" * 64])
    check_certificate(tmp_path / name, "p" * 64)


def test_the_command_makes_a_certificate_for_every_process_of_a_drive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["trepid", "keys", "create", str(tmp_path / "keys"), "--process", "mine", "--host", "10.0.0.7"]
    monkeypatch.setattr("sys.argv", command)
    assert main() == 0
    roles = {path.stem for path in (tmp_path / "keys").glob("*.crt")}
    assert {"launcher", "camera", "vehicle", "supervisor", "controller", "lead", "cv", "cnn", "mine"} < roles
    check_keys(["camera", "mine"], secured_settings(tmp_path / "keys"))
    before = contents(tmp_path / "keys")
    assert main() == 0
    assert contents(tmp_path / "keys") == before
    assert "nothing to make" in capsys.readouterr().out


def test_a_folder_that_cannot_be_written_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("sys.argv", ["trepid", "keys", "create", str(tmp_path / "file" / "keys")])
    assert main() == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
