"""Attacks with real sessions on a drive with keys: nothing foreign, malformed or replayed is acted upon."""

from pathlib import Path

import numpy as np
import pytest

from lab.bench.flood import bench_security_flood
from lab.bench.security import (
    Attack,
    AttackedDrive,
    bench_security,
    broken_messages,
    foreign,
    forge_messages,
    open_drive,
    secured_drive,
    wrong_roles,
)

pytestmark = pytest.mark.long
COUNT = 30


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory):
    with secured_drive(tmp_path_factory.mktemp("keys")) as drive:
        yield drive


def attacks(drive: AttackedDrive) -> dict[str, Attack]:
    every = [*foreign(drive), *wrong_roles(drive), *broken_messages(drive, np.random.default_rng(0))]
    return {attack.name: attack for attack in every}


@pytest.mark.parametrize(
    "name",
    [
        "certificate of another authority, trusts the car's",
        "TLS without a certificate",
        "TCP without TLS",
        "wrong topics for the role cv",
        "random bytes as a command",
        "oversized command",
        "replayed command",
    ],
)
def test_no_message_of_an_attack_is_acted_upon_and_genuine_ones_arrive_afterwards(
    drive: AttackedDrive, name: str
) -> None:
    row = attacks(drive)[name].run(drive, COUNT)
    assert row["acted_upon"] == 0
    assert row["genuine_arrive_after"]


def test_messages_of_the_right_role_do_arrive_and_malformed_ones_are_counted(drive: AttackedDrive) -> None:
    assert attacks(drive)["another type as a command"].run(drive, COUNT)["counted_as_malformed"] > 0


def test_without_keys_the_same_attack_is_acted_upon() -> None:
    with open_drive() as drive:
        assert forge_messages(drive, "no keys", {}).run(drive, COUNT)["acted_upon"] > 0


@pytest.mark.proof
def test_none_of_ten_thousand_foreign_or_malformed_messages_is_acted_upon(tmp_path: Path) -> None:
    result = bench_security(0)
    assert result["sent"] >= 10_000
    assert result["acted_upon"] == 0
    assert result["comparison"]["no keys at all"]["acted_upon"] > 0


@pytest.mark.proof
def test_under_a_flood_the_car_stays_in_its_lane_and_memory_stays_bounded() -> None:
    for row in bench_security_flood(0)["flood"].values():
        assert row["sent_per_s"] > 10_000
        assert row["departures"] == 0
        assert row["most_growth_mb"] < 50
