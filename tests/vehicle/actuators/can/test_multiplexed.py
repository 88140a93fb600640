"""Messages whose signals depend on a selector: frames are read and written as by cantools from the whole file."""

import can_rig
import cantools
import pytest

from trepid.config import InputError

DBC = """
BO_ 2566844926 DRIVE: 8 CAR
 SG_ MODE M : 0|4@1+ (1,0) [0|15] "" TREPID
 SG_ COUNTER : 4|4@1+ (1,0) [0|15] "" TREPID
 SG_ YAW m2 : 8|16@1- (0.01,0) [-300|300] "deg/s" TREPID
 SG_ BRAKE m1 : 8|12@1+ (0.01,0) [0|40] "m/s^2" TREPID
 SG_ GEAR m1 : 20|4@1+ (1,0) [0|15] "" TREPID
 SG_ WIDE m3 : 8|8@1+ (1,0) [0|255] "" TREPID
"""
"""``DRIVE`` has an identifier of 29 bits (0x18FEF1FE) and bit 31, as J1939 writes it."""

REPORT = (
    "  - {message: DRIVE, period_s: 0.02, timeout_s: 0.1, counter: {signal: COUNTER}, signals: [SIGNALS]}\n"
)
YAW = "{signal: YAW, quantity: yaw_rate_radps, scale: 57.29578}"


def map_of(folder, signals=YAW, text=DBC):
    path = can_rig.copy_map(folder)
    shipped = (folder / "shuttle.dbc").read_text()
    (folder / "shuttle.dbc").write_text(shipped + text)
    whole = path.read_text()
    start = whole.index("  - message: KINEMATICS")
    path.write_text(whole[:start] + REPORT.replace("SIGNALS", signals))
    return can_rig.load_map(path, can_rig.VEHICLE)


def receiver(signals):
    return next(each for each in signals.receivers() if each.name == "DRIVE")


def frame(**values):
    return cantools.database.load_string(DBC, database_format="dbc").messages[0].encode(values)


def test_frames_with_the_value_of_the_selector_are_read_and_others_passed_over(tmp_path):
    read = receiver(map_of(tmp_path))
    assert (read.address, read.extended) == (0x18FEF1FE, True)
    for count in range(60):
        if count % 2:
            found = read.quantities(frame(MODE=2, COUNTER=count % 16, YAW=count / 10))
            assert found["yaw_rate_radps"] == pytest.approx(count / 10 / 57.29578)
        else:
            assert read.quantities(frame(MODE=1, COUNTER=count % 16, BRAKE=3.3, GEAR=4)) is None
    assert not read.refused


def test_a_counter_that_is_in_every_frame_counts_those_that_are_passed_over(tmp_path):
    read = receiver(map_of(tmp_path))
    for count in range(0, 40, 2):  # three frames of another selector between two
        read.quantities(frame(MODE=2, COUNTER=(2 * count) % 16, YAW=1.0))
        for more in (1, 2, 3):
            read.quantities(frame(MODE=3, COUNTER=(2 * count + more) % 16, WIDE=200))
    assert not read.refused
    assert read.quantities(frame(MODE=3, COUNTER=9, WIDE=1)) is None
    assert read.refused["counter"] == 1


def test_a_multiplexed_command_carries_its_selector(tmp_path):
    path = can_rig.copy_map(tmp_path)
    dbc = tmp_path / "shuttle.dbc"
    text = dbc.read_text().replace("SG_ PERMIT_BRAKING :", "SG_ PERMIT_BRAKING M :")
    text = text.replace("SG_ ENGAGED :", "SG_ ENGAGED m1 :").replace("SG_ ACCEL_CMD :", "SG_ ACCEL_CMD m1 :")
    dbc.write_text(text)
    plain = can_rig.SHUTTLE.sender(can_rig.SHUTTLE.settings.commands[1])
    path.write_text(path.read_text().replace("    constants: {PERMIT_BRAKING: 1}\n", ""))
    sender = can_rig.load_map(path, can_rig.VEHICLE).senders()[1]
    for accel_mps2 in (-3.0, 0.0, 1.5):
        quantities = can_rig.command_quantities(can_rig.command(accel_mps2=accel_mps2))
        data = sender.frame(quantities)
        assert data == plain.frame(quantities)
        message = cantools.database.load_string(text, database_format="dbc").get_message_by_name(
            "ACC_CONTROL"
        )
        assert message.decode(data)["ACCEL_CMD"] == pytest.approx(accel_mps2)


def test_a_selector_that_is_sent_as_a_constant_is_refused(tmp_path):
    path = can_rig.copy_map(tmp_path)
    dbc = tmp_path / "shuttle.dbc"
    text = dbc.read_text().replace("SG_ PERMIT_BRAKING :", "SG_ PERMIT_BRAKING M :")
    dbc.write_text(text.replace("SG_ ENGAGED :", "SG_ ENGAGED m0 :"))
    what = "'PERMIT_BRAKING' selects the signals of a frame, and is sent as 0: leave it out"
    with pytest.raises(InputError, match=f"map.yaml:.*{what}"):
        can_rig.load_map(path, can_rig.VEHICLE)


@pytest.mark.parametrize(
    ("signals", "change", "what"),
    [
        (
            YAW + ", {signal: WIDE, quantity: driver_torque_nm}",
            ("", ""),
            "no frame of message DRIVE holds both YAW and WIDE: their selector is 2 or 3",
        ),
        (YAW, ("YAW m2 :", "YAW m2M :"), "signal YAW of message DRIVE is a selector that is multiplexed itself"),
        (YAW, ("MODE M :", "MODE :"), "signal YAW of message DRIVE is multiplexed by 0 selectors: expected one"),
        (YAW, ("GEAR m1 :", "GEAR m1M :"), "signal YAW of message DRIVE is multiplexed by 2 selectors"),
        (
            YAW,
            ("WIDE m3 : 8|8@1+ (1,0) [0|255] \"\" TREPID\n", 'WIDE m3 : 8|8@1+ (1,0) [0|255] "" TREPID\n\n'
             "SG_MUL_VAL_ 2566844926 YAW MODE 2-2, 5-7;\n"),
            "signal YAW of message DRIVE is there for the selectors 2-2, 5-7 .SG_MUL_VAL_.: expected one value",
        ),
        (YAW, ("COUNTER : 4|4", "COUNTER : 8|4"), "signals COUNTER and YAW of message DRIVE overlap"),
    ],
)  # fmt: skip
def test_signals_that_no_frame_holds_alone_are_refused_with_the_place_in_the_dbc(
    tmp_path, signals, change, what
):
    with pytest.raises(InputError, match=rf"shuttle\.dbc:\d+:1: {what}"):
        map_of(tmp_path, signals, DBC.replace(*change) if change[0] else DBC)
