"""Arming, running, the safe stop: what goes over the wire and what the outcome says, for every way in which a run can end."""

import ctypes
import math
import sys

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.cubemars.mit import DISABLE, ENABLE, NOTHING
from blocks.controllers import Impedance
from blocks.filters import Butterworth
from blocks.limiters import Saturation, SlewRate, TorqueLimiter
from blocks.mathematics import Gain, Product, Sum
from blocks.sources import StepSource
from cext.kernels import mathematics as kernels
from graph import Block, Device, Diagram, Input, Output, Param
from tests.cext.rigs import STOP, Rig, one_drive, plant_of


class At(Block):
    """Calls a function at one tick, and gives what it returns; 1 N·m at every other."""

    y = Output("N·m")

    def __init__(self, tick, action, **options):
        self.when, self.action = tick, action
        super().__init__(**options)

    def step(self, tick):
        return self.action() if tick == self.when else 1.0


class TornAngle(Block):
    """An angle that is torn after a while."""

    angle = Output("rad")

    def step(self, t):
        if t > 0.2:
            raise ValueError("torn")
        return 0.1


def raises(error):
    def action():
        raise error
    return action


def ends_in_the_safe_stop(rig, can_id=1):
    return rig.sent(can_id)[-2:] == STOP and rig.page.fenced and rig.page.state == "safe"


# A whole run


def test_a_run_arms_runs_and_stops_in_frames():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(Impedance()(knee.position, knee.velocity, 0.3)))
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick, outcome.signal, outcome.culprit, outcome.error) == ("ok", 99, 0, None, None)
    assert outcome.unconfirmed == outcome.unanswered == () and not outcome.faulted
    sent = rig.sent()
    assert sent[:2] == [ENABLE, NOTHING] and sent[-2:] == STOP
    assert len(sent) == 2 + 100 + 2 and all(data not in (ENABLE, DISABLE) for data in sent[2:-2])
    assert ends_in_the_safe_stop(rig)
    statistics = rig.statistics()
    assert (statistics["ticks"], statistics["missed"], statistics["dropped"], statistics["last_tick"]) == (100, 0, 0, 99)
    assert statistics["frames"]["sent"] == len(rig.sent()) == statistics["frames"]["received"]
    assert statistics["frames"]["foreign"] == statistics["frames"]["malformed"] == 0


def test_every_row_has_its_tick_and_its_time():
    rig = one_drive(lambda knee: 0.0)
    rig.run(150)
    assert rig.tick.tolist() == list(range(150)) and rig.time.tolist() == [tick / 200 for tick in range(150)]


def test_times_of_frames_never_go_back():
    rig = one_drive(lambda knee: 0.0)
    rig.run(50)
    times = [frame.time for frame in rig.frames]
    assert times == sorted(times) and times[0] == 0


def test_a_run_of_no_ticks_arms_and_stops():
    rig = one_drive(lambda knee: 0.0)
    outcome = rig.run(0)
    assert outcome.status == "ok" and outcome.tick == -1 and rig.sent() == [ENABLE, NOTHING, *STOP]


def test_a_rig_may_be_run_again_and_does_the_same():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0, slew=40.0)(Impedance()(knee.position, knee.velocity, 0.3)))
    rig.run(80)
    first, frames = {path: values.tolist() for path, values in rig.signals.items()}, rig.frames
    rig.run(80)
    assert {path: values.tolist() for path, values in rig.signals.items()} == first and rig.frames == frames


def test_an_answer_to_an_earlier_run_is_none():
    rig = one_drive(lambda knee: 0.0, plant=False)
    reply = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])
    rig.buses["can"].device.send(1, reply)
    assert rig.run(5).status == "ok"
    rig.buses["can"].device.send(1, reply, time=10**9)
    assert rig.run(5).status == "no answer"


# Arming


def test_authority_fades_in_and_shows_in_what_was_sent():
    rig = one_drive(lambda knee: 10.0)
    rig.run(300, fade=0.5)
    share = [min(tick / 100, 1.0) for tick in range(300)]
    assert rig["knee.torque_sent"] == pytest.approx([10.0 * s for s in share], abs=2 * 65.0 / 4095)
    rig.run(10, fade=0.0)
    assert rig["knee.torque_sent"] == pytest.approx([10.0] * 10, abs=2 * 65.0 / 4095)


def test_of_two_drives_the_one_that_does_not_answer_is_named_and_neither_moves():
    with Diagram("robot", rate=200) as robot:
        for can_id, name in ((1, "left"), (2, "right")):
            CubeMars("AK10-9-V2.0", can_id=can_id, name=name)(torque_command=10.0)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["left"], name="left")(0.0, 0.0)
    rig = Rig(robot, plant)
    outcome = rig.run(100, arming_timeout=0.1)
    assert (outcome.status, outcome.tick, outcome.unanswered) == ("no answer", -1, ("right",)) and outcome.faulted
    assert outcome.unconfirmed == ("right",)
    for can_id in (1, 2):
        assert set(rig.sent(can_id)) == {ENABLE, NOTHING, DISABLE}
        assert ends_in_the_safe_stop(rig, can_id)
    assert rig.sent(1).count(ENABLE) == 1 and rig.sent(2).count(ENABLE) == 22         # only who is silent is asked again
    times = [frame.time for frame in rig.frames]
    assert times == sorted(times) and rig.statistics()["ticks"] == 0


def test_two_drives_on_two_buses_arm_and_stop_each_on_its_own():
    with Diagram("robot", rate=200) as robot:
        for bus in ("left", "right"):
            CubeMars("AK10-9-V2.0", bus=bus, can_id=7, name=f"{bus}_knee")(torque_command=2.0 if bus == "left" else -2.0)
    rig = Rig(robot, plant_of(robot))
    assert rig.run(50).status == "ok"
    for number, sign in ((0, 1.0), (1, -1.0)):
        sent = [frame.data for frame in rig.frames if frame.sent and frame.bus == number]
        assert sent[:2] == [ENABLE, NOTHING] and sent[-2:] == STOP and len(sent) == 54
        assert math.copysign(1.0, rig[("left" if number == 0 else "right") + "_knee.torque_sent"][-1]) == sign


def test_blocks_start_at_the_present_measurement_and_those_without_a_steady_state_start_afresh():
    class Counter(Block):
        """Counts its steps."""

        u = Input("any")
        y = Output("any")

        def reset(self):
            self.count = 0

        def step(self, u):
            self.count += 1
            return u + 0.0 * self.count

    with Diagram("robot", rate=200) as robot:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
        before = Counter(name="before")
        filtered = Butterworth(cutoff=5.0, name="filter")(before(knee.position))
        behind = Counter(name="behind")(SlewRate(0.1, name="slew")(filtered))
        limited = TorqueLimiter(limit=5.0, slew=1.0, name="limiter")(Gain(1.0, unit="N·m/rad")(behind))
        knee(torque_command=limited)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(1.0, 0.0)
    rig = Rig(robot, plant)
    rig.run(20)
    position = rig["knee.position"][0]
    assert rig["filter.y"] == pytest.approx([position] * 20, rel=1e-12) and rig["slew.y"] == pytest.approx([position] * 20, rel=1e-12)
    assert rig["limiter.limited"] == pytest.approx([(tick + 1) / 200 for tick in range(20)], rel=1e-9)      # from zero, a slew a tick
    assert robot["before"].count == robot["behind"].count == 20


@pytest.mark.parametrize("times", [{"fade": math.nan}, {"fade": -1.0}, {"arming_timeout": math.nan}, {"stopping_timeout": -0.1}])
def test_times_of_a_run_are_zero_or_more(times):
    rig = one_drive(lambda knee: 1.0)
    with pytest.raises(ValueError, match="times of a run are 0 s or more"):
        rig.run(10, **times)


def test_a_run_that_waits_for_ever_for_its_devices_is_a_run():
    rig = one_drive(lambda knee: 1.0)
    assert rig.run(10, arming_timeout=math.inf, fade=math.inf).status == "ok"
    assert abs(rig["knee.torque_sent"]).max() < 0.04


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.POINTER(ctypes.c_int32), ctypes.c_void_p, ctypes.POINTER(ctypes.c_int64))
def sensor_decode(arena, slots, sizes, frame):
    """Takes every frame: the reading is its identifier."""
    arena[slots[0]] = float(frame[1] & 0x7FF)
    return 1


@ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)
def sensor_encode(arena, slots, sizes, frames):
    """Asks for nothing."""
    return 0


class Sensor(Device):
    """Speaks by itself and is never asked."""

    timeout = Param(0.05, "s", min=0.0)
    reading = Output("1")
    bus = "can"
    decode, encode = sensor_decode, sensor_encode


def test_a_sensor_that_speaks_by_itself_is_waited_for_too():
    with Diagram("robot", rate=200) as robot:
        Sensor(name="sensor")
    rig = Rig(robot)
    outcome = rig.run(20, arming_timeout=0.1)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("sensor",)) and rig.frames == []
    rig = Rig(robot)
    rig.buses["can"].device.send(42, b"")
    outcome = rig.run(20)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "sensor", 11) and set(rig["sensor.reading"]) == {42.0}
    assert outcome.unconfirmed == ()


def test_a_sensor_that_may_be_silent_for_ever_is_not_waited_for():
    with Diagram("robot", rate=200) as robot:
        Sensor(name="sensor", timeout=0.0)
    assert Rig(robot).run(20).status == "ok"


# Faults


def test_a_share_of_nan_is_a_fault_and_not_full_torque():
    @ctypes.CFUNCTYPE(ctypes.c_int, ctypes.POINTER(ctypes.c_double), ctypes.c_void_p, ctypes.c_void_p)
    def rogue(arena, slots, sizes):
        arena[6] = math.nan if arena[1] == 5.0 else arena[6]
        return 0

    class Rogue(Block):
        """A kernel that writes where it has no business."""

        kernel = rogue

    rig = one_drive(lambda knee: (Rogue(), 1.0)[1])
    outcome = rig.run(20)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("out of limits", "knee", 5) and len(rig.commands()) == 5


@pytest.mark.parametrize("tick", [0, 1, 30])
@pytest.mark.parametrize("error", [
    ValueError("no"), KeyboardInterrupt(), SystemExit(3), MemoryError(), StopIteration(), RecursionError(), AssertionError(), ZeroDivisionError()])
def test_whatever_a_python_block_raises_ends_in_the_safe_stop_within_the_tick(error, tick):
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(At(tick, raises(error), name="culprit").y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick, outcome.error) == ("exception", "culprit", tick, error) and outcome.faulted
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == tick and rig.statistics()["ticks"] == tick
    assert rig.tick.tolist() == list(range(tick))


def test_sys_exit_in_a_block_is_an_exception_of_that_block():
    rig = one_drive(lambda knee: TorqueLimiter(limit=5.0)(At(3, lambda: sys.exit("enough")).y))
    outcome = rig.run(10)
    assert outcome.status == "exception" and isinstance(outcome.error, SystemExit) and outcome.error.code == "enough"


def test_an_exception_in_an_update_is_told_too():
    class Updates(Block):
        """Fails when it remembers."""

        u = Input("N·m")
        y = Output("N·m", range=(-1.0, 1.0))

        def step(self):
            return 0.5

        def update(self, u, tick):
            if tick == 4:
                raise OSError("disk")

    rig = one_drive(lambda knee: Updates(name="updates")(knee.torque))
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "updates", 4) and isinstance(outcome.error, OSError)
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 5          # the update comes after the frames of its tick


def test_an_exception_while_arming_is_told_and_nothing_was_commanded():
    class Settles(Block):
        """Fails to find its steady state."""

        u = Input("N·m")
        y = Output("N·m", range=(-1.0, 1.0))

        def settle(self, u):
            raise RuntimeError("unsettled")

        def step(self, u):
            return 0.0

    rig = one_drive(lambda knee: Settles(name="settles")(knee.torque))
    outcome = rig.run(10)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("exception", "settles", -1) and rig.commands() == []
    assert ends_in_the_safe_stop(rig)


def test_an_exception_in_the_plant_ends_the_run_and_names_its_block():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=400) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(position=TornAngle(name="wearer").angle, velocity=0.0)
    outcome = Rig(robot, plant).run(100)
    assert outcome.status == "exception" and outcome.culprit == "wearer" and str(outcome.error) == "torn"


BETWEEN = {
    "nothing but a limiter": lambda u: TorqueLimiter(limit=9.0)(u),
    "a limiter with slew": lambda u: TorqueLimiter(limit=9.0, slew=50.0)(u),
    "a saturation": lambda u: Saturation(-9.0, 9.0)(u),
    "a slew rate": lambda u: TorqueLimiter(limit=9.0)(SlewRate(50.0)(u)),
    "a gain": lambda u: Gain(0.5)(Saturation(-9.0, 9.0)(u)),
    "a gain of zero": lambda u: TorqueLimiter(limit=9.0)(Gain(0.0)(u)),
    "a sum": lambda u: Sum("+-")(Saturation(-4.0, 4.0)(u), 1.0),
    "a product": lambda u: TorqueLimiter(limit=9.0)(Product()(u, 0.0)),
    "a filter": lambda u: TorqueLimiter(limit=9.0)(Butterworth(cutoff=20.0)(u)),
}


@pytest.mark.parametrize("between", BETWEEN)
def test_nan_in_a_torque_command_is_a_fault_and_never_a_frame_behind(between):
    rig = one_drive(lambda knee: BETWEEN[between](At(20, lambda: math.nan).y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("not finite", "knee", 20)
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 20 and rig.statistics()["ticks"] == 20


@pytest.mark.parametrize("between", ["a gain of zero", "a product", "a filter"])
@pytest.mark.parametrize("value", [math.inf, -math.inf])
def test_an_infinity_that_becomes_nan_is_a_fault(between, value):
    rig = one_drive(lambda knee: BETWEEN[between](At(20, lambda: value).y))
    outcome = rig.run(100)
    assert outcome.status == "not finite" and 20 <= outcome.tick <= 22 and ends_in_the_safe_stop(rig)
    limit = 9.0 * 1.01
    assert all(abs(torque) <= limit for torque in rig["knee.torque_sent"])


@pytest.mark.parametrize("value", [math.inf, -math.inf, 1e308])
def test_an_infinity_behind_a_limiter_is_its_limit_and_no_more(value):
    rig = one_drive(lambda knee: TorqueLimiter(limit=9.0)(At(20, lambda: value).y))
    assert rig.run(40, fade=0.0).status == "ok"
    assert abs(rig["knee.torque_sent"][20]) == pytest.approx(9.0, abs=2 * 65.0 / 4095)
    assert rig["knee.torque_sent"][21] == pytest.approx(1.0, abs=2 * 65.0 / 4095)


@pytest.mark.parametrize("value, status", [(math.nan, "not finite"), (math.inf, "not finite"), (18.1, "out of limits"), (-1e300, "out of limits")])
def test_a_native_block_that_breaks_its_promise_is_stopped_at_the_actuator(value, status):
    class Liar(Block):
        """Says it stays within a newton metre."""

        gain = Gain.parameters["gain"]
        u = Input("any")
        y = Output("any", range=(-1.0, 1.0))
        kernel = kernels.gain

    rig = one_drive(lambda knee: Liar(1.0)(At(20, lambda: value).y))
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == (status, "knee", 20)
    assert ends_in_the_safe_stop(rig) and len(rig.commands()) == 20


def test_if_one_drive_refuses_none_of_the_tick_is_sent():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="good")(torque_command=1.0)
        CubeMars("AK10-9-V2.0", can_id=2, name="bad")(torque_command=TorqueLimiter(limit=5.0)(At(6, lambda: math.nan).y))
    rig = Rig(robot, plant_of(robot))
    outcome = rig.run(50)
    assert (outcome.culprit, outcome.tick) == ("bad", 6) and len(rig.commands(1)) == len(rig.commands(2)) == 6
    assert ends_in_the_safe_stop(rig, 1) and ends_in_the_safe_stop(rig, 2)


def test_a_fault_that_a_drive_reports_ends_the_run():
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=200) as plant:
        EmulatedCubeMars.of(robot["knee"], name="knee")(0.0, 0.0, fault=StepSource(0.0, 2.0, 0.1).y)
    rig = Rig(robot, plant)
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit) == ("device fault", "knee") and 20 <= outcome.tick <= 22
    assert ends_in_the_safe_stop(rig)


def test_a_drive_that_falls_silent_ends_the_run_after_its_timeout():
    """Someone pulls the plug: the plant no longer hears or answers."""
    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee", timeout=0.05)(torque_command=1.0)
    rig = Rig(robot)
    host = rig.buses["can"].device
    reply = bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0])
    for tick in range(30):
        host.send(1, reply, time=0)
    outcome = rig.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("silent", "knee", 11)              # first tick later than 0.05 s after the answer
    assert ends_in_the_safe_stop(rig) and outcome.unconfirmed == ("knee",) and len(rig.commands()) == 11
    assert rig["knee.age"] == pytest.approx([tick / 200 for tick in range(11)], abs=1e-9)


def test_a_timeout_of_zero_waits_for_ever():
    rig = one_drive(lambda knee: 0.0, plant=False, timeout=0.0)
    rig.buses["can"].device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    assert rig.run(1000).status == "ok"


BAD = {
    "short": (1, b"\x01\x80\x00\x80\x08\x00\x00", False, "malformed"),
    "empty": (1, b"", False, "malformed"),
    "long": (1, bytes(64), False, "malformed"),
    "of another id inside": (1, b"\x02\x90\x00\x90\x08\x00\x46\x00", False, "malformed"),
    "extended": (1, b"\x01\x90\x00\x90\x08\x00\x46\x00", True, "foreign"),
    "of another device": (9, b"\x09\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "from id 0 for another": (0, b"\x09\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "a remote request": (1 | 0x40000000, b"\x01\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
    "an error frame": (1 | 0x20000000, b"\x01\x90\x00\x90\x08\x00\x46\x00", False, "foreign"),
}


@pytest.mark.parametrize("kind", BAD)
def test_frames_that_are_no_answer_change_nothing_and_are_counted(kind):
    identifier, data, extended, counted = BAD[kind]
    rig = one_drive(lambda knee: 0.0, plant=False, timeout=0.0)
    device = rig.buses["can"].device
    device.send(1, bytes([1, 0x80, 0, 0x80, 0x08, 0, 70, 0]))
    for _ in range(5):
        device.send(identifier, data, extended)
    assert rig.run(10).status == "ok"
    frames = rig.statistics()["frames"]
    other = {"malformed": "foreign", "foreign": "malformed"}[counted]
    assert (frames["received"], frames[counted], frames[other]) == (6, 5, 0)
    assert set(rig["knee.temperature"]) == {30.0} and len(set(rig["knee.position"])) == 1


@pytest.mark.parametrize("kind", BAD)
def test_frames_that_are_no_answer_do_not_arm(kind):
    identifier, data, extended, _ = BAD[kind]
    rig = one_drive(lambda knee: 0.0, plant=False)
    rig.buses["can"].device.send(identifier, data, extended)
    assert rig.run(10, arming_timeout=0.05).status == "no answer"


def test_a_flood_of_foreign_frames_is_taken_64_a_tick():
    rig = one_drive(lambda knee: 0.0)
    for _ in range(500):
        rig.buses["can"].device.send(9, b"\x00")
    assert rig.run(20).status == "ok"
    frames = rig.statistics()["frames"]
    assert frames["foreign"] == 500


# The fence


class RaisesFence(Block):
    """Does what a guardian would: raises the fence from outside."""

    u = Input("N·m")
    y = Output("N·m", range=(-5.0, 5.0))

    def step(self, u, tick):
        if tick == 30:
            self.page.raise_fence()
        return 5.0


def test_behind_a_fence_no_command_is_sent_and_the_run_ends_in_the_safe_stop():
    rig = one_drive(lambda knee: RaisesFence(name="guardian")(knee.torque))
    rig.schedule.python_blocks[0].page = rig.page
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick) == ("fenced", 30)
    assert len(rig.commands()) == 30 and ends_in_the_safe_stop(rig)


def test_a_fence_raised_before_the_first_run_lets_nothing_through():
    rig = one_drive(lambda knee: 1.0)
    rig.page.raise_fence()
    outcome = rig.run(10)
    assert (outcome.status, outcome.tick) == ("fenced", -1) and set(rig.sent()) == set(STOP)


def test_a_fence_raised_while_arming_enables_nothing_any_more():
    class Guardian(Block):
        """In the plant, where it runs while the robot arms."""

        y = Output("1")

        def step(self, tick):
            if tick == 3:
                self.page.raise_fence()
            return 0.0

    with Diagram("robot", rate=200) as robot:
        CubeMars("AK10-9-V2.0", can_id=1, name="knee")(torque_command=1.0)
    with Diagram("plant", rate=200) as plant:
        Guardian(name="guardian")
    rig = Rig(robot, plant)
    plant["guardian"].page = rig.page
    outcome = rig.run(100)
    assert (outcome.status, outcome.tick) == ("fenced", -1)
    assert rig.sent() == [ENABLE, NOTHING] * 4 + STOP * (len(rig.sent()[8:]) // 2)
