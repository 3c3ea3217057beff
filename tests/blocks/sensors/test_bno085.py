"""A BNO085 in its mode UART-RVC: the message of its data sheet, damaged streams, and its emulator."""

import math
import random
import struct

import numpy as np
import pytest

from blocks.sensors import BNO085RVC, EmulatedBNO085RVC
from graph import Diagram
from tests.blocks.actuators.wire import MALFORMED, TAKEN, Wired
from tests.blocks.running import player, run

BYTES, LOST = 0, 1
NOTED = 2
EXAMPLE = bytes.fromhex("AA AA DE 01 00 92 FF 25 08 8D FE EC FF D1 03 00 00 00 E7")  # of the data sheet


def message(index, yaw=0, pitch=0, roll=0, accel=(0, 0, 1000)):
    body = struct.pack("<B6h3x", index % 256, yaw, pitch, roll, *accel)
    return b"\xaa\xaa" + body + bytes([sum(body) % 256])


def values(wired):
    return [math.degrees(wired[name]) for name in ("yaw", "pitch", "roll")] + [*wired["accel"]]


def test_message_of_the_data_sheet():
    wired = Wired(BNO085RVC)
    assert wired.hear(BYTES, EXAMPLE) == TAKEN
    assert values(wired) == pytest.approx([0.01, -1.10, 20.85, -3.638, -0.196, 9.581], abs=5e-4)
    assert EXAMPLE == message(222, 1, -110, 2085, (-371, -20, 977))


@pytest.mark.parametrize(
    "changed", [*range(2, 19), *((place, word) for place in (3, 5, 7) for word in (18001, -18001))]
)
def test_a_wrong_checksum_or_angle_gives_no_value_and_the_next_message_is_found(changed):
    damaged = bytearray(message(1, 100, 200, 300))
    if isinstance(changed, int):
        damaged[changed] ^= 0x40
    else:
        struct.pack_into("<h", damaged, *changed)
        damaged[18] = sum(damaged[2:18]) % 256
    wired = Wired(BNO085RVC)
    wired.hear(BYTES, message(0, 5, 6, 7))
    assert wired.hear(BYTES, bytes(damaged)) == MALFORMED and values(wired)[:3] == pytest.approx([0.05, 0.06, 0.07])
    assert wired.hear(BYTES, message(2, 8, 9, 10)) == TAKEN and values(wired)[:3] == pytest.approx([0.08, 0.09, 0.10])
    assert (wired["received"], wired["lost"], wired["corrupt"]) == (2, 1, 1)


def test_messages_are_found_in_any_pieces_and_between_other_bytes():
    """The other bytes are headers and messages without their end, and values may look like a header."""
    dice = random.Random(1)
    for _ in range(200):
        sent, stream = 0, b""
        for index in range(dice.randrange(2, 12)):
            stream += dice.choice((b"", b"\xaa", b"\xaa\xaa", EXAMPLE[: dice.randrange(19)], bytes(25)))
            stream += b"\x55" * 19  # ends what only looks like a message; with zeros, some would be one
            stream += message(index, dice.randrange(18000), accel=dice.choice(((0, 0, 0), (-0x5556,) * 3)))
            sent += 1
        wired = Wired(BNO085RVC)
        while stream:
            cut = dice.randrange(1, 65)
            wired.hear(BYTES, stream[:cut])
            stream = stream[cut:]
        assert wired["received"] == sent and wired["lost"] == wired["late"] == 0


def test_bytes_before_a_loss_of_the_line_do_not_complete_a_message_after_it():
    wired = Wired(BNO085RVC)
    wired.hear(BYTES, EXAMPLE[:10])
    wired.hear(LOST, b"")
    assert wired.hear(BYTES, EXAMPLE[10:]) == NOTED and wired["received"] == 0
    assert wired.hear(BYTES, EXAMPLE) == TAKEN


def played(ticks, **inputs):
    with Diagram("robot", rate=200) as robot:
        sensor = BNO085RVC(name="imu")
    with Diagram("plant", rate=1000) as plant:
        given = {name: value() if callable(value) else value for name, value in inputs.items()}
        EmulatedBNO085RVC.of(sensor, name="imu")(**given)
    return run(robot, ticks, plant=plant, substeps=5)


def test_the_emulated_sensor_sends_its_inputs_at_100_hz():
    time = np.arange(5000) / 1000
    turn = 3.0 * np.sin(time)
    recording = played(1000, yaw=lambda: player(turn, "rad"), pitch=-0.7, roll=2.0, accel=(1.0, -2.0, 9.0))
    assert recording.outcome.status == "ok" and recording["imu.received"][-1] == pytest.approx(500, abs=2)
    assert recording["imu.age"].max() < 0.016 and recording["imu.lost"][-1] == recording["imu.corrupt"][-1] == 0
    late = np.interp(recording.time - recording["imu.age"], time, turn)
    assert np.abs(recording["imu.yaw"] - late)[5:].max() < 0.02
    assert recording["imu.pitch"][-1] == pytest.approx(-0.7, abs=1e-4)
    assert recording["imu.accel[1]"][-1] == pytest.approx(-2.0, abs=5e-3)


def test_lost_and_damaged_messages_are_counted_and_silence_ends_the_run():
    recording = played(2000, dropped=0.1)
    assert recording.outcome.status == "ok" and recording["imu.lost"][-1] == pytest.approx(100, abs=30)
    recording = played(2000, broken=0.1)
    assert recording["imu.corrupt"][-1] == pytest.approx(100, abs=30)
    assert abs(recording["imu.lost"][-1] - recording["imu.corrupt"][-1]) <= 5  # some before the first
    outcome = played(400, silent=lambda: player(np.arange(2000) > 1000, "1", bool)).outcome
    assert outcome.status == "silent" and outcome.culprit == "imu"
