"""Emergency stops: a press, however brief, blocks all commands of its tick."""

import math

import pytest

from blocks.actuators import CubeMars
from blocks.actuators.mit_frames import DISABLE, ENABLE, NOTHING
from blocks.logic import Compare
from blocks.models import Limb
from blocks.safety import EmergencyStop, EmulatedEStop, EStopHeartbeat
from blocks.sources import StepSource
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, DiagramError, Output, compile, stack, subsystem
from tests.cext.rigs import Rig, ends_in_the_safe_stop, plant_of

RATE, PRESSED_AT = 200, 0.5  # Hz, s


class Truth(Block):
    """Values of a list, tick by tick, then its last."""

    y = Output("1", dtype=bool)

    def __init__(self, values, **options):
        self.values = values
        super().__init__(**options)

    def step(self, tick):
        return self.values[min(tick, len(self.values) - 1)]


class Number(Truth):
    """The same as numbers."""

    y = Output("1")


def robot_with(*stops):
    """A knee commanded to 1 N·m, and emergency stops. stops : functions that wire one each"""
    with Diagram("robot", rate=RATE) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
        for stop in stops:
            stop()
    return Rig(robot, plant_of(robot))


def test_the_run_ends_in_the_tick_in_which_it_is_pressed_and_nothing_of_that_tick_is_sent():
    rig = robot_with(lambda: EmergencyStop(name="stop")(Truth([False] * 40 + [True, False]).y))
    outcome = rig.run(200)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("e-stop", "stop", 40)
    assert len(rig.commands()) == 40 and ends_in_the_safe_stop(rig)


def test_nan_counts_as_pressed():
    class Doubtful(Block):
        """NaN where a truth should be, from tick 7 on."""

        y = Output("1")

        def step(self, tick):
            return math.nan if tick >= 7 else 0.0

    rig = robot_with(lambda: EmergencyStop()(Compare(">")(Doubtful().y, 0.5)))
    outcome = rig.run(50)
    assert (outcome.status, outcome.tick) == ("e-stop", 7) and len(rig.commands()) == 7


def test_any_of_several_stops_ends_run():
    rig = robot_with(
        lambda: EmergencyStop(name="first")(Truth([False]).y),
        lambda: EmergencyStop(name="second")(Truth([False] * 9 + [True]).y),
    )
    outcome = rig.run(50)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("e-stop", "second", 9)


def test_one_pressed_element_of_a_vector_is_sufficient():
    rig = robot_with(lambda: EmergencyStop()(Compare(">")(stack(Number([0.0]).y, Number([0.0] * 5 + [1.0]).y), 0.5)))
    outcome = rig.run(50)
    assert (outcome.status, outcome.tick) == ("e-stop", 5)


def test_emergency_stop_in_conditional_subsystem_is_refused():
    def complaint(make):
        with pytest.raises(DiagramError) as raised, Diagram("robot", rate=RATE) as diagram:
            make()
            compile(diagram)
        return [(d.code, d.message) for d in raised.value.diagnostics]

    def in_a_part_that_is(**how):
        with subsystem(
            "part", **{key: value(Truth([True], name="on")) if callable(value) else value for key, value in how.items()}
        ):
            EmergencyStop(name="stop")(Truth([False]).y)

    [(code, message)] = complaint(lambda: in_a_part_that_is(every=4))
    assert code == "TW018" and message == "runs every 4 ticks, but must run in every tick"
    found = complaint(lambda: in_a_part_that_is(enabled=lambda on: on.y))
    assert {code for code, _ in found} == {"TW018"} and "does not run while on.y is false" in found[0][1]

    def wired_into_one():
        with subsystem("part", enabled=Truth([True], name="on").y):
            pressed = Truth([False], name="pressed").y
        EmergencyStop(name="stop")(pressed)

    [(code, message)] = complaint(wired_into_one)
    assert code == "TW018" and message == "part/pressed.y keeps its last value while on.y is false"


# The heartbeat


def heartbeat_rig(*, pressed=lambda: False, silent=lambda: False, period=0.02, timeout=0.1, knee_answers_from=0.0):
    """A knee and a button, both emulated. pressed, silent : functions that make the plant's signals; knee_answers_from
    : s
    """
    with Diagram("robot", rate=RATE) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
        EStopHeartbeat(name="button", timeout=timeout)
    with Diagram("plant", rate=5 * RATE) as plant:
        drive, limb = robot["knee"].emulator(name="drive"), Limb(inertia=0.1, damping=0.5, stiffness=0.0, reflex=0.0)
        limb(torque=drive.torque)
        drive(position=limb.position, velocity=limb.velocity)
        robot["button"].emulator(name="emulated", period=period)(pressed=pressed(), silent=silent())
        thief = Thief(knee_answers_from, name="thief")
    rig = Rig(robot, plant)
    thief.host = rig.buses["can"].host
    return rig


class Thief(Block):
    """In the plant: takes away what the drive has answered, until some instant in s."""

    taken = Output("1")

    def __init__(self, until, **options):
        self.until = until
        super().__init__(**options)

    def step(self, t):
        return len(self.host.receive()) if t < self.until else 0.0


class Window(Block):
    """True between two instants, in s from the plant's begin, which is that of arming. then : called once, half a
    second after it
    """

    y = Output("1", dtype=bool)

    def __init__(self, begin, end, then=lambda: None, **options):
        self.begin, self.end, self.then = begin, end, then
        super().__init__(**options)

    def step(self, t, tick):
        if tick == round((self.end + 0.5) * 5 * RATE):
            self.then()
        return self.begin <= t < self.end


def from_then_on(time=PRESSED_AT):
    return Compare(">")(StepSource(time=time)(), 0.5)


def test_heartbeat_of_button_permits_run():
    rig = heartbeat_rig()
    assert rig.run(400).status == "ok"
    assert rig["button.pressed"].max() == 0.0 and rig["button.age"].max() < 0.03
    assert rig["button.count"][-1] == pytest.approx(2.0 / 0.02, abs=3)


@pytest.mark.hazard("H9c")
def test_press_ends_run_in_its_tick_before_commands_are_sent():
    rig = heartbeat_rig(pressed=from_then_on)
    outcome = rig.run(400)
    assert (outcome.status, outcome.culprit) == ("e-stop", "button")
    assert PRESSED_AT <= outcome.tick / RATE <= PRESSED_AT + 0.03
    assert len(rig.commands()) == outcome.tick and ends_in_the_safe_stop(rig)


@pytest.mark.hazard("H9c")
def test_a_silent_button_ends_the_run_after_its_timeout():
    rig = heartbeat_rig(silent=from_then_on, timeout=0.15)
    outcome = rig.run(400)
    assert (outcome.status, outcome.culprit) == ("silent", "button")
    assert PRESSED_AT + 0.12 <= outcome.tick / RATE <= PRESSED_AT + 0.17 and ends_in_the_safe_stop(rig)


def test_missing_button_prevents_arming():
    rig = heartbeat_rig(silent=lambda: True)
    outcome = rig.run(10)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("button",)) and set(rig.sent()) <= {
        ENABLE,
        NOTHING,
        DISABLE,
    }


def test_a_press_while_arming_blocks_every_command():
    rig = heartbeat_rig(pressed=lambda: True)
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("e-stop", "button", -1) and rig.commands() == []
    assert ends_in_the_safe_stop(rig)


@pytest.mark.parametrize("pressed_at", [0.0, 0.01])
def test_a_press_while_arming_that_is_released_before_the_first_tick_ends_it(pressed_at):
    """The drive answers late, so that arming goes on long after the press."""
    rig = heartbeat_rig(pressed=lambda: Window(pressed_at, pressed_at + 0.021, name="press").y, knee_answers_from=0.2)
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("e-stop", "button", -1) and rig.commands() == []
    assert DISABLE in rig.sent() and ends_in_the_safe_stop(rig)


def test_released_press_during_pre_flight_ends_run_before_confirmation():
    rig = heartbeat_rig(pressed=lambda: Window(0.3, 0.321, lambda: writer.confirm(rig.shared.question), name="press").y)
    writer = Writer(rig.shared, "keys")
    outcome = rig.run(10, answered=lambda: None, confirm=True)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("e-stop", "button", -1)
    assert set(rig.sent()) == {NOTHING, DISABLE}
    assert ends_in_the_safe_stop(rig)


def test_nan_at_the_emulator_is_pressed():
    class Torn(Block):
        """NaN from 0.3 s on."""

        y = Output("1")

        def step(self, t):
            return math.nan if t >= 0.3 else 0.0

    rig = heartbeat_rig(pressed=lambda: Compare(">")(Torn().y, 0.5))
    assert rig.run(400).status == "e-stop"


# Its frames, byte for byte


class Says(Block):
    """Puts frames on a bus itself: at each tick of a plant the listed ones, else a valid frame."""

    y = Output("1")

    def __init__(self, frames, **options):
        self.frames, self.end = frames, None
        super().__init__(**options)

    def reset(self):
        self.counter = 0

    def step(self, tick, t):
        for identifier, data in self.frames.get(tick, [(0x123, None)]):
            if data is None:
                data, self.counter = bytes([self.counter % 256, 0x5A]), self.counter + 1
            self.end.send(identifier, data, time=round(t * 1e9))
        return 0.0


def heard(frames, ticks=60):
    """(outcome, rig) of a run whose button sends `frames`: {tick of the plant: [(id, data or None for a good one)]}"""
    with Diagram("robot", rate=RATE) as robot:
        EStopHeartbeat(name="button", can_id=0x123, timeout=0.05)
    with Diagram("plant", rate=RATE) as plant:
        EmulatedEStop(name="other", can_id=0x124)(silent=True)
        says = Says(frames, name="says")
    rig = Rig(robot, plant)
    says.end = rig.buses["estop"].device
    return rig.run(ticks), rig


@pytest.mark.parametrize("second", [0x00, 0x5B, 0x4A, 0xA5, 0xFF, 0xDA, 0x50])
def test_only_one_byte_of_256_reads_as_released(second):
    outcome, _ = heard({20: [(0x123, bytes([77, second]))]})
    assert (outcome.status, outcome.culprit) == ("e-stop", "button") and 19 <= outcome.tick <= 21


@pytest.mark.parametrize("data", [b"", b"\x07", b"\x07\x5a\x00", bytes(8), bytes(7) + b"\x5a"])
def test_frames_of_another_length_change_nothing_and_are_counted(data):
    outcome, rig = heard({20: [(0x123, data), (0x123, None)]})
    assert (
        outcome.status == "ok" and rig.statistics()["frames"]["malformed"] == 1 and rig["button.pressed"].max() == 0.0
    )


def test_frames_of_other_ids_are_ignored():
    outcome, rig = heard({20: [(0x122, b"\x00\x00"), (0x123, None)]})
    assert outcome.status == "ok" and rig.statistics()["frames"]["foreign"] == 1


def test_constant_counter_is_not_a_heartbeat():
    outcome, rig = heard({tick: [(0x123, b"\x09\x5a")] for tick in range(20, 100)})
    assert (outcome.status, outcome.culprit) == ("silent", "button") and 28 <= outcome.tick <= 33
    assert rig.statistics()["frames"]["malformed"] >= 8


def stream(number):
    """Frame of a released button."""
    return 0x123, bytes([number % 256, 0x5A])


@pytest.mark.parametrize("recorded", [(7, 8), (7, 8, 9), (10, 90, 180), (0, 64, 128, 192), range(1, 256, 51)])
def test_recorded_frames_that_are_repeated_in_turn_are_no_heartbeat(recorded):
    outcome, _ = heard({tick: [stream(recorded[tick % len(recorded)])] for tick in range(20, 400)}, ticks=300)
    assert outcome.status in ("silent", "kernel status 64") and outcome.culprit == "button" and outcome.tick <= 40


@pytest.mark.hazard("H9c")
@pytest.mark.parametrize("offset", [0, 1, 2, 5, 40, 100, 128, 200, 255])
@pytest.mark.parametrize("dies", ["neither", "first", "second"])
def test_two_senders_of_one_id_end_the_run_before_the_death_of_either_is_hidden(offset, dies):
    """The second begins at tick 20 of the plant, and one of them ends at tick 60."""
    frames = {}
    for tick in range(200):
        first, second = [stream(tick)], [stream(tick + offset)]
        frames[tick] = (first if dies != "first" or tick < 60 else []) + (
            second if tick >= 20 and (dies != "second" or tick < 60) else []
        )
    outcome, _ = heard(frames, ticks=190)
    assert outcome.status in ("kernel status 64", "silent") and outcome.culprit == "button" and outcome.tick < 85
    with Diagram("robot", rate=RATE):
        assert "another sender uses id 0x123" in EStopHeartbeat(can_id=0x123).fault_text(64)


@pytest.mark.parametrize("lost", [1, 3, 8])
def test_lost_frames_are_no_disorder(lost):
    """Of every ten frames some are lost, in a row."""
    frames = {tick: [stream(tick)] if tick % 10 >= lost else [] for tick in range(400)}
    assert heard(frames, ticks=380)[0].status == "ok"


def test_a_frame_that_the_network_delivers_twice_or_late_is_no_disorder():
    frames = {tick: [stream(tick)] for tick in range(400)}
    for tick in range(30, 390, 40):
        frames[tick] = [stream(tick), stream(tick)]
        frames[tick + 20], frames[tick + 21] = [stream(tick + 21)], [stream(tick + 20)]
    assert heard(frames, ticks=380)[0].status == "ok"


@pytest.mark.parametrize("dead", ["operator", "wearer"])
def test_each_of_several_buttons_is_watched(dead):
    ids = {"operator": 0x123, "wearer": 0x124}
    with Diagram("robot", rate=RATE) as robot:
        for name, can_id in ids.items():
            EStopHeartbeat(name=name, can_id=can_id, timeout=0.05)
    with Diagram("plant", rate=RATE) as plant:
        for name, can_id in ids.items():
            silent = from_then_on(0.3) if name == dead else False
            EmulatedEStop(name=name, can_id=can_id)(silent=silent)
    outcome = Rig(robot, plant).run(200)
    assert (outcome.status, outcome.culprit) == ("silent", dead) and 0.3 < outcome.tick / RATE < 0.4


def test_two_buttons_of_one_id_are_an_error():
    with pytest.raises(DiagramError, match="wearer: shares CAN id 256"), Diagram("robot", rate=RATE) as robot:
        EStopHeartbeat(name="operator"), EStopHeartbeat(name="wearer")
        compile(robot)


def test_message_with_constant_counter_may_press():
    outcome, _ = heard({tick: [(0x123, b"\x09\x5a")] for tick in range(20, 24)} | {24: [(0x123, b"\x09\x00")]})
    assert outcome.status == "e-stop" and 23 <= outcome.tick <= 25


def test_a_press_that_is_released_within_one_tick_is_latched():
    outcome, rig = heard({20: [(0x123, b"\x50\x00"), (0x123, b"\x51\x5a")]})
    assert (outcome.status, outcome.culprit) == ("e-stop", "button") and 19 <= outcome.tick <= 21


def test_the_counter_wraps():
    outcome, rig = heard({}, ticks=600)
    assert outcome.status == "ok" and rig.statistics()["frames"]["malformed"] == 0


def test_a_timeout_of_never_is_refused():
    with Diagram("robot", rate=RATE), pytest.raises(DiagramError, match="timeout"):
        EStopHeartbeat(timeout=0.0)


def test_an_estop_heartbeat_has_no_stop_frames():
    with Diagram("robot", rate=RATE):
        button = EStopHeartbeat()
    assert button.zero_frames() == button.disable_frames() == button.enable_frames() == [] and math.isfinite(
        button.timeout
    )
