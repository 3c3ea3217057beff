"""RobStride in MIT mode: faults that are asked for, and the drive's own time-out, frame by frame."""

import math
import struct

import pytest

from blocks.actuators import EmulatedRobStrideMIT, RobStride, RobStrideMIT
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.actuators.robstride import mit
from blocks.limiters import TorqueLimiter
from blocks.models import Limb
from blocks.safety import Rearm
from graph import Block, Diagram, DiagramError, Output, Param
from tests.blocks.actuators.wire import AUTHORITY, FOREIGN, MALFORMED, TAKEN, Wired
from tests.cext.rigs import Rig

NOTED, COMMANDED, ANSWERED = 2, 3, 6  # cext/abi.pxd
TIME, PERIOD = 0, 3  # slots of the arena
QUESTION = bytes.fromhex("ffffffffffff00fb")
WRITTEN = bytes.fromhex("28700000d0070000")  # 100 ms, as the manual writes it
LIMIT, MODE = b"\x0b\x70\0\0" + struct.pack("<f", 20.0), b"\x05\x70" + bytes(6)
REST = bytes.fromhex("057fff7ff7ff012c")  # a reply of drive 5: at rest, 30 °C


def faults(word, order="little", can_id=5):
    return bytes([can_id]) + word.to_bytes(4, order) + bytes(3)


def drive(**parameters):
    return Wired(RobStrideMIT, "RS03", can_id=5, **parameters)


def return_settings(wired):
    """The drive returns every setting as it was written."""
    for data in (WRITTEN, LIMIT, MODE):
        assert wired.hear(0x305, data) == NOTED


def armed():
    """A drive that has returned its settings and no faults."""
    wired = drive()
    return_settings(wired)
    assert wired.hear(0xFD, faults(0)) == ANSWERED
    return wired


def test_arming_verifies_timeout_and_queries_faults_before_enable():
    limit = struct.pack("<f", 20.0)
    assert RobStrideMIT("RS03", can_id=5).set_up_frames() == [
        (5, False, DISABLE),
        (5, False, mit.OPERATION),
        (0x405, False, WRITTEN),
        (0x405, False, b"\x0b\x70\0\0" + limit),
        (0x305, False, b"\x19\x70" + bytes(6)),
        (0x305, False, b"\x1b\x70" + bytes(6)),
        (0x305, False, b"\x28\x70" + bytes(6)),
        (0x305, False, b"\x0b\x70" + bytes(6)),
        (0x305, False, b"\x05\x70" + bytes(6)),
        (5, False, QUESTION),
    ]
    plain = RobStrideMIT("RS03", can_id=5, can_timeout=0.0)
    assert plain.set_up_frames() == [(5, False, data) for data in (DISABLE, mit.OPERATION)]
    assert plain.enable_frames() == [(5, False, ENABLE)]
    assert (plain.own_timeout, plain.ready, RobStrideMIT("RS03").own_timeout) == (None, None, 0.1)


def test_a_time_out_shorter_than_three_ticks_is_rejected():
    with pytest.raises(DiagramError, match="shorter than three ticks"), Diagram("robot", rate=20) as robot:
        RobStrideMIT("RS03", name="knee")(torque_command=0.0)
        from graph import compile

        compile(robot)


def test_fault_replies_follow_the_read_and_are_not_motion():
    wired = drive()
    assert wired.hear(0xFD, REST) == TAKEN
    before = wired["position"]
    assert wired.hear(0x405, WRITTEN) == NOTED
    return_settings(wired)
    assert wired["talk"][0] == 1.0
    assert wired.hear(0xFD, faults(1 << 14 | 1 << 2)) == ANSWERED
    assert (wired["position"], wired["fault"]) == (before, 1 << 14 | 1 << 2)
    assert wired.block.fault_in_words(wired["fault"]) == "under-voltage (bit 2), stalled (bit 14)"
    assert wired.hear(0xFD, faults(0)) == TAKEN, "not asked for: it is a reply, whatever it holds"


@pytest.mark.parametrize(
    "word, order, read",
    [
        (0, "little", 0),
        (1, "little", 1),
        (0x408F, "little", 0x408F),
        (1 << 7, "big", 1 << 7),
        (0x4001, "big", 0x4001),
        (1 << 9, "little", 1 << 9),
        (1 << 16, "little", 1 << 16),
    ],
)
def test_fault_words_are_decoded_in_the_byte_order_that_has_only_known_bits(word, order, read):
    wired = drive()
    return_settings(wired)
    assert wired.hear(0xFD, faults(word, order)) == ANSWERED and wired["fault"] == read
    assert wired.block.fault_in_words(1 << 9 | 1 << 20) == "position at the start (bit 9), bit 20"


@pytest.mark.parametrize("value", [0, 1999, 20000])
def test_another_time_out_is_a_fault_that_names_the_firmware(value):
    wired = drive()
    for _ in range(3):
        assert wired["fault"] == 0 and wired["talk"][0] == 0.0
        wired.hear(0x305, b"\x28\x70\0\0" + value.to_bytes(4, "little"))
    assert wired["fault"] == 1 << 33 | 1 << 32 | value and wired["talk"][0] == 1.0
    words = wired.block.fault_in_words(wired["fault"])
    assert words.startswith(f"canTimeout (0x7028) reads {value:g}, 2000 was written; ")
    assert "RS03 has these parameters in MIT mode from firmware 0.3.1.41 on" in words


def test_foreign_write_is_a_command_and_foreign_read_is_not():
    wired = drive()
    return_settings(wired)
    assert wired.hear(0x405, WRITTEN) == NOTED and wired.hear(0x305, bytes.fromhex("1970000000000000")) == NOTED
    assert wired.hear(0x405, bytes.fromhex("2870000000000000")) == COMMANDED, "the drive's time-out switched off"
    assert wired.hear(0x405, WRITTEN[:7]) == MALFORMED and wired.hear(0x306, WRITTEN) == FOREIGN


def ticks(wired, count, rate=200.0, answer=True, first=0):
    """Data of the frames of so many ticks, each answered before the next."""
    said = []
    wired.arena[PERIOD] = 1.0 / rate
    for tick in range(first, first + count):
        wired.arena[TIME] = tick / rate
        ((identifier, data),) = wired.say(torque_command=1.0)
        assert identifier == 5
        said.append(data)
        if answer:
            wired.hear(0xFD, faults(0) if data == QUESTION else REST)
    return said


def test_fault_query_replaces_one_command_per_second():
    said = ticks(armed(), 1001)
    assert [tick for tick, data in enumerate(said) if data == QUESTION] == [200, 400, 600, 800, 1000]


def test_a_query_waits_until_no_reply_is_pending():
    wired = armed()
    assert QUESTION not in ticks(wired, 199) + ticks(wired, 1, answer=False, first=199) + ticks(
        wired, 40, answer=False, first=200
    )
    for _ in range(41):
        wired.hear(0xFD, REST)
    assert ticks(wired, 1, first=240) == [QUESTION]


def test_a_lost_reply_delays_the_query_by_at_most_50_ticks():
    wired = armed()
    ticks(wired, 190)
    ticks(wired, 1, answer=False, first=190)
    assert [tick for tick, data in enumerate(ticks(wired, 100, first=191), 191) if data == QUESTION] == [249]


def test_unarmed_drive_is_not_queried():
    assert QUESTION not in ticks(drive(), 500)


def test_no_query_is_sent_before_torque_is_enabled():
    wired = armed()
    wired.arena[AUTHORITY] = 0.0
    assert QUESTION not in ticks(wired, 300)


def test_a_non_finite_command_is_rejected_also_in_the_tick_of_a_query():
    wired = armed()
    ticks(wired, 200)
    wired.arena[TIME] = 1.0
    assert wired.say(torque_command=float("nan")) == -1


def test_query_leaves_reported_command_unchanged():
    wired = armed()
    ticks(wired, 200)
    before = wired["torque_sent"], wired["sent"].tolist()
    wired.arena[TIME] = 1.0
    ((_, data),) = wired.say(torque_command=-3.0)
    assert data == QUESTION and (wired["torque_sent"], wired["sent"].tolist()) == before


def test_the_command_before_a_query_has_gains_for_two_periods():
    """It stays in force for two periods. With the longer one the law is scaled further down, and never up."""
    wired = armed()
    gains = []
    for tick in range(190, 203):
        wired.arena[TIME], wired.arena[PERIOD] = tick / 200, 1 / 200
        wired["age"] = 0.005 if tick != 201 else 0.010
        ((_, data),) = wired.say(stiffness_command=100.0, damping_command=3.0, position_command=0.02)
        gains.append((data == QUESTION, wired["sent"][2]))
        wired.hear(0xFD, faults(0) if data == QUESTION else REST)
    assert [tick for tick, (asked, _) in enumerate(gains, 190) if asked] == [200]
    assert 0.0 < gains[9][1] < 0.9 * gains[8][1], "the tick before it"
    assert gains[7][1] == gains[8][1] == gains[12][1] and gains[10][1] == gains[9][1], (
        "what was sent is what is in force"
    )


def test_a_lost_or_late_query_reply_is_never_decoded_as_motion():
    wired = armed()
    ticks(wired, 200)
    assert ticks(wired, 1, first=200, answer=False) == [QUESTION]
    assert wired.hear(0xFD, REST) == TAKEN, "a reply that was late"
    assert wired.hear(0xFD, faults(1 << 3)) == ANSWERED and wired["fault"] == 1 << 3
    ticks(wired, 199, first=201)
    assert ticks(wired, 1, first=400, answer=False) == [QUESTION], "whose answer is lost"
    for _ in range(50):
        assert wired.hear(0xFD, REST) == TAKEN
    assert wired.hear(0xFD, faults(0)) == TAKEN, "nothing is awaited any more"


@pytest.mark.parametrize("lag", [1, 2, 3, 4, 20])
def test_fault_words_are_not_motion_behind_an_interface_that_delays_every_reply(lag):
    """By so many ticks, as a serial adapter does."""
    wired, pending, answers = armed(), [], []
    for tick in range(1300):
        wired.arena[TIME], wired.arena[PERIOD] = tick / 200, 1 / 200
        ((_, data),) = wired.say(torque_command=1.0)
        pending.append(faults(0 if tick < 1000 else 1 << 3) if data == QUESTION else REST)
        if tick >= lag:
            answers.append(wired.hear(0xFD, pending.pop(0)))
            assert wired["position"] == pytest.approx(0.0, abs=1e-3)
    assert answers.count(ANSWERED) >= 4 and set(answers) == {TAKEN, ANSWERED} and wired["fault"] == 1 << 3


# Whole runs


class Late(Block):
    """A word of faults from 0.5 s on."""

    word = Param(0, "1", "bits")
    y = Output("1", dtype=int)

    def step(self, t):
        return self.word if t >= 0.5 else 0


def lived(ticks=400, word=0, torque=2.0, rate=200, drive_parameters=None, **emulator):
    with Diagram("robot", rate=rate) as robot:
        knee = RobStrideMIT("RS03", can_id=5, name="knee", **(drive_parameters or {}))
        knee(torque_command=torque)
    with Diagram("plant", rate=rate * 5) as plant:
        emulated, limb = knee.emulator(**emulator), Limb(inertia=0.5, damping=5.0, stiffness=20.0, reflex=0.0)
        limb(torque=emulated.torque)
        emulated(position=limb.position, velocity=limb.velocity, fault=Late(word)())
    rig = Rig(robot, plant)
    return rig, rig.run(ticks, fade=0.0, arming_timeout=0.5), knee


def test_fault_queries_do_not_disturb_motion():
    rig, outcome, _ = lived(1000)
    assert outcome.status == "ok" and outcome.unconfirmed == () and rig["knee.fault"].max() == 0
    commands = [frame.data for frame in rig.frames if frame.sent and frame.id == 5]
    assert 5 <= commands.count(QUESTION) <= 7
    assert abs(rig["knee.position"][-1] - 0.1) < 3e-3 and abs(rig["knee.position"]).max() < 0.11
    assert rig.control.reports.missed["knee"] == 0


def test_a_fault_while_running_ends_the_run_with_its_name():
    rig, outcome, knee = lived(word=1 << 14)
    assert (outcome.status, outcome.culprit) == ("device fault", "knee") and 100 <= outcome.tick <= 310
    assert knee.fault_in_words(rig.control.final[rig.schedule.signals["knee.fault"].slot]) == "stalled (bit 14)"


def test_a_drive_with_a_fault_is_not_armed():
    with Diagram("robot", rate=200) as robot:
        knee = RobStrideMIT("RS03", can_id=5, name="knee")
        knee(torque_command=2.0)
    with Diagram("plant", rate=1000) as plant:
        knee.emulator()(position=0.0, velocity=0.0, fault=1 << 1)
    rig = Rig(robot, plant)
    outcome = rig.run(50, fade=0.0)
    assert (outcome.status, outcome.culprit) == ("device fault", "knee") and outcome.tick <= 0
    commands = {frame.data for frame in rig.frames if frame.sent and frame.id == 5}
    assert commands <= {DISABLE, mit.OPERATION, QUESTION, ENABLE, NOTHING}


def test_firmware_without_parameters_is_armed_only_if_configured():
    rig, outcome, knee = lived(parameters_known=False)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("knee",)) and rig.control.reports.unready == ["knee"]
    assert "from firmware 0.3.1.41 on" in knee.unready_in_words()
    assert lived(parameters_known=False, drive_parameters={"can_timeout": 0.0})[1].status == "ok"


def test_emulated_drive_stops_after_its_timeout():
    wired = Wired(EmulatedRobStrideMIT, "RS03", can_id=5)
    for identifier, data in ((0x405, WRITTEN), (5, ENABLE), (5, NOTHING)):
        assert wired.hear(identifier, data) == TAKEN
    for time, runs in ((0.09, 1.0), (0.11, 0.0)):
        wired.arena[TIME] = time
        wired.step(position=0.0, velocity=0.0)
        assert wired["enabled"] == runs


def test_the_emulated_drive_returns_its_faults_and_its_parameters():
    wired = Wired(EmulatedRobStrideMIT, "RS03", can_id=5)
    wired.step(position=0.0, velocity=0.0, fault=1 << 14 | 1)
    for identifier, data in ((0x405, WRITTEN), (0x305, bytes.fromhex("2870000000000000")), (5, QUESTION)):
        wired.hear(identifier, data)
    assert wired.say() == [(0x405, WRITTEN), (0x305, WRITTEN), (0xFD, faults(1 << 14 | 1))]
    wired.step(position=0.0, velocity=0.0, fault=0)
    wired.hear(5, QUESTION)
    assert wired.say() == [(0xFD, faults(1 << 14 | 1))], "latched until they are cleared"
    wired.hear(5, mit.CLEAR_FAULT), wired.hear(5, QUESTION)
    assert wired.say()[1] == (0xFD, faults(0))


class Broken(Block):
    """2 N·m, and NaN in one tick."""

    torque = Output("N·m")

    def step(self, tick):
        return math.nan if tick == 60 else 2.0


class Ask(Block):
    """True in one tick."""

    asked = Output("1", dtype=bool)

    def step(self, tick):
        return tick == 120


def test_arming_again_reads_the_time_out_back_again():
    with Diagram("robot", rate=200) as robot:
        knee = RobStrideMIT("RS03", can_id=5, name="knee")
        knee(torque_command=TorqueLimiter(limit=5.0)(Broken(name="law")()))
        Rearm(name="again")(Ask(name="ask")())
    with Diagram("plant", rate=1000) as plant:
        knee.emulator(name="drive")(position=0.0, velocity=0.0)
    rig = Rig(robot, plant)
    outcome = rig.run(600, fade=0.0, rearm=[rig.schedule.inputs["again"]["request"]], notify=lambda what, outcome: None)
    reads = [frame.time for frame in rig.frames if frame.sent and frame.id == 0x305]
    questions = [frame.time for frame in rig.frames if frame.sent and frame.data == QUESTION]
    assert outcome.status == "ok" and len(outcome.faults) == 1 and len(reads) == 10
    assert not [time for time in questions if 0.31e9 < time < 0.6e9], "while it waits nothing is asked"
    assert [time for time in questions if time > 1.5e9]


class Between(Block):
    """`value` between two times, 0 before and after."""

    since = Param(0.0, "s", "begin")
    until = Param(0.0, "s", "end")
    value = Param(1, "1", "meanwhile", dtype=object, fixed=True)
    y = Output("1")

    def configure(self):
        self.outputs = {"y": Output("1", dtype=type(self.value)).named("y")}

    def step(self, t):
        return self.value if self.since <= t < self.until else type(self.value)()


@pytest.mark.parametrize("cycled", [True, False])
@pytest.mark.parametrize(
    "kind, word",
    [(RobStrideMIT, 1 << 14), (RobStride, 1 << 4), (RobStride, 256 << 14)],
    ids=["MIT", "feedback", "report"],
)
def test_a_power_cycle_clears_a_fault_so_that_the_run_can_be_armed_again(kind, word, cycled):
    """A drive keeps its faults until then; the run has nothing else to learn from that they are gone."""
    with Diagram("robot", rate=200) as robot:
        knee = kind("RS03", can_id=5, name="knee")
        knee(torque_command=2.0)
        Rearm(name="again")(Between(since=2.0, until=2.1, value=True)())
    with Diagram("plant", rate=1000) as plant:
        fault = Between(since=0.5, until=1.8 if cycled else 9.0, value=word, name="fault")()
        knee.emulator(name="drive")(
            position=0.0,
            velocity=0.0,
            fault=fault,
            power_lost=Between(since=1.6, until=1.9 if cycled else 1.6, value=True, name="power")(),
        )
    rig, told = Rig(robot, plant), []
    rearm = [rig.schedule.inputs["again"]["request"]]
    outcome = rig.run(700, fade=0.0, rearm=rearm, notify=lambda what, outcome: told.append((what, outcome.status)))
    assert told[0] == ("fault", "device fault")
    assert told[1:] == ([("rearm", "ok")] if cycled else [("refused", "device fault")])
    assert outcome.status == ("ok" if cycled else "device fault") and bool(rig["knee.fault"][-1]) is not cycled
