"""Conformance of the blocks, arming against the emulated drive, and the set-up as a dialogue with it."""

import struct

import pytest

from blocks.actuators.mit_frames import DISABLE, ENABLE
from graph import DiagramError
from graph.conformance import check_block
from graph.dialogue import Confirm, Listen, Rejected, Send, Show
from graph.family import Request
from tests.blocks.actuators.wire import FOREIGN, IDLE, MALFORMED, TAKEN, Wired
from tickwork_damiao import Damiao, EmulatedDamiao, protocol
from tickwork_damiao.family import FAMILY, answers, details
from tickwork_damiao.models import MODELS

NOTED, COMMANDED, TIME = 2, 3, 0  # of cext/abi.pxd


@pytest.mark.parametrize("kind", [Damiao, EmulatedDamiao])
def test_block_passes_the_conformance_test(kind):
    assert check_block(kind)


class Bench:
    """An emulated drive with a clock. sent : frames that it received"""

    def __init__(self, **parameters):
        self.drive = Wired(EmulatedDamiao, **{"model": "DM-J4310", "can_id": 1, "master_id": 17} | parameters)
        self.sent, self.replies, self.lines = [], [], []

    def exchange(self, identifier, data):
        self.drive.hear(identifier, data)
        self.drive.step()
        return self.drive.say()

    def answer(self, dialogue):
        reply = None
        while True:
            try:
                step = dialogue.send(reply)
            except StopIteration as end:
                return end.value
            if isinstance(step, Send):
                identifier, _, data = step.frame
                self.sent.append(data)
                self.replies += [(each, False, body) for each, body in self.exchange(identifier, data)]
                reply = True
            elif isinstance(step, Listen):
                reply, self.replies = self.replies, []
            else:
                assert isinstance(step, (Show, Confirm))
                self.lines += step.lines if isinstance(step, Show) else ()
                reply = True


def arm(driver, bench):
    """Send the frames of a set-up. Returns what decode said to each reply."""
    said = []
    for identifier, _, data in driver.block.set_up_frames():
        said += [driver.hear(*reply) for reply in bench.exchange(identifier, data)]
    return said


def test_arming_reads_the_ranges_of_the_unit_and_refuses_others():
    bench, driver = Bench(), Wired(Damiao, "DM-J4310")
    assert arm(driver, bench) == [IDLE, *[NOTED] * 7]
    assert driver["talk"][0] == 1.0 and driver["fault"] == 0.0
    assert bench.drive["registers"][protocol.TIMEOUT] == 2000.0  # 0.1 s, in units of 50 µs
    other, driver = Bench(wire_torque=20.0), Wired(Damiao, "DM-J4310")
    for _ in range(3):
        arm(driver, other)
    assert driver["fault"] != 0.0
    assert "TMAX (register 23) reads 20, 10 is expected; set wire_torque = 20" in driver.block.fault_in_words(
        driver["fault"]
    )
    arm(matching := Wired(Damiao, "DM-J4310", wire_torque=20.0), other)
    assert matching["talk"][0] == 1.0 and matching["fault"] == 0.0


def test_every_status_is_reported_and_only_that_of_an_enabled_drive_is_taken():
    driver = Wired(Damiao, "DM-J4310")
    for status in range(16):
        state = bytes([status << 4 | 1]) + bytes.fromhex("7fff7ff7ff2030")
        assert driver.hear(17, state) == (TAKEN if status == 1 else IDLE)
        assert driver["fault"] == (status if status > 1 else 0.0) and driver["temperature"] == 48.0
    for identifier, data, said in (
        (17, b"\x02" + bytes(7), FOREIGN),
        (17, b"", FOREIGN),
        (18, b"\x11" + bytes(7), FOREIGN),
        (17 | 0x80000000, b"\x11" + bytes(7), FOREIGN),
        (17, b"\x11" + bytes(6), MALFORMED),
        (0x7FF, protocol.write(9, 0, 1)[2], COMMANDED),
        (0x7FF, protocol.write(9, 0, 2)[2], FOREIGN),
        (0x7FF, protocol.read(9, 1)[2], FOREIGN),
    ):
        assert driver.hear(identifier, data) == said, (identifier, data)


def test_no_command_is_a_special_frame():
    driver = Wired(Damiao, "DM-J4310", limit="peak")
    driver["limits"] = [*driver["wire"], 1e9, 1.0]
    top = dict(zip(("position", "velocity", "stiffness", "damping", "torque"), driver["wire"]))
    for code in range(4085, 4096):
        torque = -10.0 + min(code + 0.5, 4095.0) * 20.0 / 4095
        [(_, data)] = driver.say(**{f"{name}_command": x for name, x in (top | {"torque": torque}).items()})
        assert data[:7] != bytes([255]) * 7 or data[7] < 0xF8


def test_the_drive_stops_itself_and_stays_so_until_the_error_is_cleared():
    bench = Bench()
    bench.exchange(*protocol.write(protocol.TIMEOUT, 2000, 1)[::2])
    assert bench.exchange(1, ENABLE)[0][1][0] == 0x11
    bench.drive.arena[TIME] = 0.2  # s
    bench.drive.step()
    assert bench.exchange(1, ENABLE)[0][1][0] == 0xD1
    assert bench.exchange(1, DISABLE)[0][1][0] == 0xD1
    assert bench.answer(FAMILY.set_up(Request(1, writes=("clear=1",)))) is True
    assert bench.exchange(1, ENABLE)[0][1][0] == 0x11


def test_zero_id_and_registers_are_set_stored_and_confirmed():
    bench = Bench()
    bench.drive["position"] = 0.4
    asked = Request(1, zero=True, new_id=3, save=True, writes=("MST_ID=19", "TMAX=12"))
    assert bench.answer(FAMILY.set_up(asked)) is True, bench.lines
    assert bench.lines[-1] == "done: id 3, 0.000 rad" or bench.lines[-1] == "done: id 3, -0.000 rad"
    bench.drive["power_lost"] = 1.0
    bench.drive.step()
    bench.drive["power_lost"] = 0.0
    [found] = answers([(i, False, data) for i, data in bench.exchange(*protocol.read(7, 3)[::2])], [3], [])
    assert found.settings == {"master_id": 19}
    assert "TMAX 12 N·m: those of no model" in bench.answer(details(found)).notes[0]


def test_scan_names_the_models_with_the_ranges_of_a_unit():
    bench = Bench(model="DM-J8009")
    [found] = answers([(i, False, data) for i, data in bench.exchange(*protocol.read(7, 1)[::2])], [1, 2], [])
    answer = bench.answer(details(found))
    assert answer.notes == ["PMAX 12.5 rad, VMAX 45 rad/s, TMAX 54 N·m: those of DM-J8009"]
    assert (answer.enabled, answer.fault, answer.can_id) == (False, "", 1) and abs(answer.position) < 1e-3


def test_unsupported_set_ups_are_rejected_before_any_change():
    for request, words in (
        (Request(1, new_id=16), "so 1 to 15"),
        (Request(1, writes=("MST_ID=0",)), "from 1 to 2046"),
        (Request(1, writes=("PMAX=0",)), "above 0"),
        (Request(1, writes=("ESC_ID=2",)), "--set-id"),
        (Request(1, writes=("Gr=2",)), "read-only"),
        (Request(1, writes=("TIMEOUT=0.5",)), "with a number"),
        (Request(1, reads=("PMAXX",)), "PMAX"),
    ):
        with pytest.raises(Rejected, match=words):
            FAMILY.check(request)
    assert Bench().answer(FAMILY.set_up(Request(2, zero=True))) is None


def test_a_drive_without_ratings_needs_a_limit_and_ids_differ():
    assert [name for name, model in MODELS.items() if model.rated is None] == [*MODELS][2:]
    for parameters, words in (({"model": "DM-J8009"}, "limit="), ({"model": "DM-J4310", "master_id": 1}, "different")):
        with pytest.raises((ValueError, DiagramError), match=words):
            Damiao(**parameters)


def test_stop_is_confirmed_by_disabled_and_faulted_drives_only():
    status = Damiao("DM-J4310").stop_reply().enabled
    for code in range(16):
        value = status.low + (code ^ 8) * (status.high - status.low) / 15.0
        assert (value > 0.0) == (1 <= code <= 7)


def test_registers_are_those_of_the_manual():
    assert [protocol.REGISTERS[name] for name in "TIMEOUT CTRL_MODE PMAX VMAX TMAX".split()] == [9, 10, 21, 22, 23]
    assert protocol.write(9, 2000, 1) == (0x7FF, False, b"\x01\x00\x55\x09" + struct.pack("<I", 2000))
