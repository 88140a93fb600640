"""The register model of the PCA9685 against the data sheet (NXP, rev. 4)."""

import pytest

from sim_harness.counterparts.pca9685 import Registers

MODE1, LED0, PRE_SCALE = 0x00, 0x06, 0xFE
AI, SLEEP = 0x20, 0x10


@pytest.fixture
def chip() -> Registers:
    """A chip awake with auto-increment at about 50 Hz."""
    made = Registers()
    made.write(bytes([PRE_SCALE, 121]))
    made.write(bytes([MODE1, AI]))
    return made


def test_after_power_on_the_chip_sleeps_at_200_hz_without_pulses() -> None:
    chip = Registers()
    assert chip.read(MODE1, 1) == b"\x11"
    assert chip.frequency_hz == pytest.approx(200.0, rel=0.02)
    assert [chip.pulse_us(channel) for channel in range(16)] == [None] * 16


def test_the_prescale_changes_in_sleep_only(chip) -> None:
    assert chip.frequency_hz == pytest.approx(50.0, rel=0.01)
    chip.write(bytes([PRE_SCALE, 30]))
    assert chip.read(PRE_SCALE, 1) == bytes([121])


def test_counts_are_shares_of_the_period(chip) -> None:
    chip.write(bytes([LED0 + 4 * 5, 0, 0, 307 & 0xFF, 307 >> 8]))
    assert chip.pulse_us(5) == pytest.approx(307 / 4096 / chip.frequency_hz * 1e6)
    assert chip.pulse_us(5) == pytest.approx(1500.0, rel=0.01)


def test_a_pulse_that_begins_later_ends_later(chip) -> None:
    chip.write(bytes([LED0, 0x00, 0x0F, 0x00, 0x01]))  # on at 3840, off at 256
    assert chip.pulse_us(0) == pytest.approx(512 / 4096 / chip.frequency_hz * 1e6)


def test_full_off_and_sleep_end_the_pulses(chip) -> None:
    chip.write(bytes([LED0, 0, 0, 0x33, 0x01]))
    assert chip.pulse_us(0) is not None
    chip.write(bytes([LED0 + 3, 0x11]))
    assert chip.pulse_us(0) is None
    chip.write(bytes([LED0 + 3, 0x01]))
    chip.write(bytes([MODE1, AI | SLEEP]))
    assert chip.pulse_us(0) is None


def test_without_auto_increment_a_transfer_stays_on_its_register(chip) -> None:
    chip.write(bytes([MODE1, 0]))
    chip.write(bytes([LED0, 1, 2, 3, 4]))
    assert chip.read(LED0, 2) == bytes([4, 4])
