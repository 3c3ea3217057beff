"""An emulated RobStride drive that is set up: its id, its unique number, its firmware, its gains, and what it keeps
without power.
"""

import struct

import pytest

from blocks.actuators import EmulatedRobStride
from blocks.actuators.robstride import queries
from graph import DiagramError
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.wire import EXTENDED, FOREIGN, TAKEN, Wired
from tests.shared import entries

HOST = 0xFD
COUNTING = bytes(range(1, 9))
LOC_KP, SPD_KP, RUN_MODE, CAN_TIMEOUT = 0x701E, 0x701F, 0x7005, 0x7028


def emulated(model="RS03", **parameters):
    wired = Wired(EmulatedRobStride, model, **parameters)
    wired["temperature"] = 30.0
    return wired


def ask(wired, frame, taken=TAKEN):
    """What a drive answers to a frame of blocks.actuators.robstride.queries: (identifier without its flag, data)."""
    identifier, extended, data = frame
    assert extended and wired.hear(identifier | EXTENDED, data) == taken
    wired.step(position=0.0, velocity=0.0)
    return [(identifier & 0x1FFFFFFF, data) for identifier, data in wired.say()]


def value(wired, index, can_id=127):
    ((identifier, data),) = ask(wired, queries.read(index, can_id))
    assert identifier == 17 << 24 | can_id << 8 | HOST
    return struct.unpack("<f" if index not in (RUN_MODE, CAN_TIMEOUT) else "<I", data[4:])[0]


def write(wired, index, number):
    layout = {CAN_TIMEOUT: "<I", RUN_MODE: "<I"}.get(index, "<f")
    wired.hear(reference.identifier(18, HOST, 127), struct.pack("<HH", index, 0) + struct.pack(layout, number))
    wired.step(position=0.0, velocity=0.0)
    wired.say()


def test_each_drive_has_a_unique_id():
    numbers = [
        ask(emulated(**which), queries.get_id(can_id))
        for which, can_id in (
            ({}, 127),
            ({"can_id": 3}, 3),
            ({"model": "RS02"}, 127),
            ({"unique": "1122334455667788"}, 127),
        )
    ]
    assert [identifier for ((identifier, _),) in numbers] == [
        127 << 8 | 0xFE,
        3 << 8 | 0xFE,
        127 << 8 | 0xFE,
        127 << 8 | 0xFE,
    ]
    assert numbers[3][0][1].hex() == "1122334455667788" and len({data for ((_, data),) in numbers}) == 4
    assert ask(emulated(), queries.get_id(127)) == numbers[0], "the same in every run"


@pytest.mark.parametrize("unique", ["12", "112233445566778Z"])
def test_a_unique_number_of_another_form_is_refused(unique):
    with pytest.raises(DiagramError, match="16 hex digits"):
        EmulatedRobStride("RS03", unique=unique)


def test_a_new_id_applies_at_once_and_returns_the_unique_number():
    wired = emulated(unique="1122334455667788")
    assert ask(wired, queries.set_id(127, 9)) == [(9 << 8 | 0xFE, bytes.fromhex("1122334455667788"))]
    assert ask(wired, queries.get_id(127), taken=FOREIGN) == []
    assert value(wired, LOC_KP, 9) == 30.0
    wired.step(position=0.0, velocity=0.0, power_lost=True)
    wired.step(position=0.0, velocity=0.0, power_lost=False)
    assert ask(wired, queries.get_id(9))[0][0] == 9 << 8 | 0xFE, "also after its power was off"


@pytest.mark.parametrize("new", [0, 128, 255])
def test_an_impossible_id_is_not_accepted(new):
    assert ask(emulated(), queries.set_id(127, new))[0][0] == 127 << 8 | 0xFE


def test_a_set_id_frame_of_another_library_is_accepted():
    told = [
        entry
        for entry in entries("robstride_other_types")
        if entry["inputs"]["command"] == "set can id 9 (type 7) host 0xFD"
    ]
    for entry in told:
        frame = entry["frame"]["arbitration_id"], True, bytes.fromhex(entry["frame"]["data_hex"])
        assert ask(emulated(can_id=entry["inputs"]["motor_id"]), frame)[0][0] == 9 << 8 | 0xFE
    assert told


def test_stop_with_version_request_stops_and_returns_version():
    wired = emulated(firmware="0.3.1.42")
    wired.hear(reference.identifier(3, HOST, 127), bytes(8))
    wired.step(position=0.0, velocity=0.0)
    wired.say()
    assert wired["enabled"] == 1.0
    ((identifier, data),) = ask(wired, queries.version(127))
    assert (
        identifier == 2 << 24 | 127 << 8 | HOST
        and data == bytes.fromhex("00c4560003012a00")
        and wired["enabled"] == 0.0
    )
    assert queries.firmware(identifier, True, data, 127) == "0.3.1.42.0"
    ((_, data),) = ask(emulated("CyberGear"), queries.version(127))
    assert data[:3] != bytes.fromhex("00c456"), "a CyberGear takes it for a stop"


def test_drive_gains_can_be_read_and_written():
    one, other = emulated(gains=(("loc_kp", 40.0), ("cur_kp", 0.125))), emulated()
    assert (value(one, LOC_KP), value(one, 0x7010), value(other, LOC_KP), value(other, 0x7010)) == (
        40.0,
        0.125,
        30.0,
        0.0,
    )
    write(other, SPD_KP, 2.5)
    assert value(other, SPD_KP) == 2.5
    with pytest.raises(DiagramError, match="mechPos is not a writable parameter of RS03"):
        EmulatedRobStride("RS03", gains=(("mechPos", 1.0),))


@pytest.mark.parametrize("saved", [False, True])
def test_saved_settings_survive_a_power_loss(saved):
    wired = emulated()
    before = value(wired, LOC_KP)
    for index, number in ((LOC_KP, 12.0), (CAN_TIMEOUT, 2000), (RUN_MODE, 3)):
        write(wired, index, number)
    if saved:
        ((identifier, _),) = ask(wired, queries.save(127))
        assert identifier >> 24 == 2
    wired.step(position=0.0, velocity=0.0, power_lost=True)
    wired.step(position=0.0, velocity=0.0, power_lost=False)
    assert (value(wired, LOC_KP), value(wired, CAN_TIMEOUT)) == ((12.0, 2000) if saved else (before, 0))
    assert value(wired, RUN_MODE) == 0, "the mode is never kept"


@pytest.mark.parametrize("model, data", [("CyberGear", COUNTING), ("RS03", bytes(8)), ("RS03", COUNTING[::-1])])
def test_malformed_save_command_saves_nothing(model, data):
    """On a CyberGear type 22 changes the baud rate."""
    wired = emulated(model)
    write(wired, LOC_KP, 12.0)
    assert ask(wired, (22 << 24 | HOST << 8 | 127, True, data), taken=FOREIGN) == []
    wired.step(position=0.0, velocity=0.0, power_lost=True)
    wired.step(position=0.0, velocity=0.0, power_lost=False)
    assert value(wired, LOC_KP) == 30.0
