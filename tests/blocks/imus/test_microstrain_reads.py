"""What an emulated MicroStrain sensor answers when its settings are read back, byte for byte as the vendor's SDK lays
out the reply.
"""

import pytest

from blocks.imus import EmulatedMicroStrain
from blocks.imus.microstrain import mip
from tests.blocks.actuators.wire import TAKEN, Wired

BYTES = 0  # cext/lines/stream_frames.pxd: a chunk of a line
OK, INVALID = 0, 3  # codes of an acknowledgement


def sensor(model="3DM-GX5-25"):
    return Wired(EmulatedMicroStrain, model=model, streaming_at_start=False)


def ask(wired, descriptor_set, descriptor, *data):
    """(code of the acknowledgement, [(descriptor, data) of the fields behind it])."""
    assert wired.hear(BYTES, mip.packet(descriptor_set, (descriptor, bytes(data)))) == TAKEN
    packets, left, corrupt = mip.split(b"".join(chunk for _, chunk in wired.say()))
    assert (len(packets), left, corrupt) == (1, b"", 0)
    (kind, (command, code)), *fields = mip.fields(packets[0])
    assert packets[0][2] == descriptor_set and kind == mip.ACKNOWLEDGE and command == descriptor
    return code, fields


def test_the_heading_source_reads_back():
    wired = sensor()
    for source in (1, 0):
        assert ask(wired, 0x0D, 0x18, mip.WRITE, source) == (OK, [])
        assert ask(wired, 0x0D, 0x18, mip.READ) == (OK, [(0x87, bytes([source]))])
    assert ask(wired, 0x0D, 0x18, mip.WRITE) == (INVALID, []) and ask(wired, 0x0D, 0x18) == (INVALID, [])


def test_the_low_pass_of_each_field_reads_back():
    wired = sensor()
    assert ask(wired, 0x0C, 0x50, mip.WRITE, 0x04, 1, 1, 0x01, 0x2C, 0) == (OK, [])
    assert ask(wired, 0x0C, 0x50, mip.READ, 0x04) == (OK, [(0x8B, bytes([0x04, 1, 1, 0x01, 0x2C, 0]))])
    assert ask(wired, 0x0C, 0x50, mip.READ, 0x05) == (OK, [(0x8B, bytes([0x05, 1, 0, 0, 100, 0]))]), (
        "automatic: half of 200 Hz"
    )
    assert ask(wired, 0x0C, 0x50, mip.WRITE, 0x00, 0, 1, 0x00, 0x32, 0) == (OK, []), "field 0: all of them"
    for field in (0x04, 0x05, 0x06, 0x17):
        assert ask(wired, 0x0C, 0x50, mip.READ, field) == (OK, [(0x8B, bytes([field, 0, 1, 0x00, 0x32, 0]))])


def test_an_automatic_low_pass_is_half_the_rate_of_its_field():
    wired = sensor()
    assert ask(wired, 0x0C, 0x08, mip.WRITE, 1, 0x05, 0, 10) == (OK, [])
    assert ask(wired, 0x0C, 0x50, mip.READ, 0x05) == (OK, [(0x8B, bytes([0x05, 1, 0, 0, 50, 0]))])


@pytest.mark.parametrize("data", [(mip.READ,), (mip.READ, 0x00), (mip.READ, 0x0A), (mip.WRITE, 0x04, 1, 1, 0)])
def test_a_read_of_no_field_and_a_write_that_is_too_short_are_refused(data):
    assert ask(sensor(), 0x0C, 0x50, *data) == (INVALID, [])


def test_a_newer_sensor_replies_with_the_set_and_a_float():
    wired = sensor("3DM-CV7-AHRS")
    assert ask(wired, 0x0C, 0x54, mip.WRITE, 0x80, 0x05, 1, 1, 0x42, 0x20, 0, 0) == (OK, [])
    assert ask(wired, 0x0C, 0x54, mip.READ, 0x80, 0x05) == (OK, [(0xD4, bytes([0x80, 0x05, 1, 1, 0x42, 0x20, 0, 0]))])
    assert ask(wired, 0x0C, 0x54, mip.READ, 0x82, 0x05) == (INVALID, [])
    assert ask(wired, 0x0D, 0x50, mip.WRITE, 0, 4, 1) == (OK, [])
    assert ask(wired, 0x0D, 0x50, mip.READ, 0, 4) == (OK, [(0xD0, bytes([0, 4, 1]))])


def test_saved_settings_persist_after_restart():
    wired = sensor()
    ask(wired, 0x0C, 0x50, mip.WRITE, 0x04, 1, 1, 0, 40, 0)
    ask(wired, 0x0C, 0x30, 3)
    ask(wired, 0x0C, 0x50, mip.WRITE, 0x04, 1, 1, 0, 90, 0)
    ask(wired, 0x01, 0x7E)
    assert ask(wired, 0x0C, 0x50, mip.READ, 0x04) == (OK, [(0x8B, bytes([0x04, 1, 1, 0, 40, 0]))])
