"""Nothing enables a motor before the operator has confirmed, and every drive is watched from its first reply on: for
each family, in virtual time, on in-memory buses.
"""

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride, RobStrideMIT
from blocks.limiters import TorqueLimiter
from blocks.safety import EStopHeartbeat
from cext.schedule.mailbox_writer import Writer
from graph import Block, Diagram, Output
from tests.cext.rigs import Rig

RATE, SUBSTEPS = 200, 5
EXTENDED = 0x80000000
FAMILIES = [
    (CubeMars, "AK10-9-V2.0", {}),
    (RobStride, "RS03", {}),
    (RobStride, "RS03", {"mode": "velocity"}),
    (RobStride, "CyberGear", {}),
    (RobStrideMIT, "RS03", {}),
    (CubeMarsV3, "AK80-9-V3.0", {}),
    (CubeMarsV3, "AK80-9-V3.0", {"enter": True, "report_rate": 200.0}),
    (CubeMarsServo, "AK80-9", {}),
    (CubeMarsServo, "AK80-9-V3.0", {"report_rate": 0.0}),
]
NAMES = [f"{kind.__name__}-{model}-{len(parameters)}" for kind, model, parameters in FAMILIES]
families = pytest.mark.parametrize("kind, model, parameters", FAMILIES, ids=NAMES)


class Play(Block):
    """In the plant: calls an action in a step, and gives the value of a function of the step."""

    y = Output("any")

    def __init__(self, value=lambda step: 0.0, actions=None, **options):
        self.value, self.actions = value, actions or {}
        super().__init__(**options)

    def step(self, tick):
        self.actions.get(tick, int)()
        return self.value(tick)


class Operator:
    """One drive on a rig whose operator acts at given steps of the plant, of 1 ms.

    acts : {step: "confirm", which also arms again, or "stop"}; torque : command in N·m
    stray : torque in N·m that the drive produces without a command, as a function of the step
    joint : (position, velocity) as a function of the step; wearer : parameters of the emulated drive
    """

    def __init__(self, kind, model, parameters, acts=None, *, torque=0.0, stray=lambda step: 0.0, joint=None, **wearer):
        with Diagram("robot", rate=RATE) as robot:
            self.drive = kind(model, can_id=1, name="knee", **parameters)
            name = next(iter(self.drive.inputs))
            name = "torque_command" if "torque_command" in self.drive.inputs else name
            self.drive(**{name: TorqueLimiter(limit=4.0)(torque) if name == "torque_command" else torque})
        with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
            played = {step: self.act(act) for step, act in (acts or {}).items()}
            motor = self.drive.emulator(name="motor", **wearer)
            path = Moved(joint or (lambda step: (0.3, 0.0)), name="joint")()
            motor(position=path.position, velocity=path.velocity, stray_torque=Play(stray, played, name="stray")())
        self.rig = Rig(robot, plant)
        self.writer = Writer(self.rig.shared, "keys")
        self.shown = []

    def act(self, name):
        if name == "stop":
            return lambda: self.writer.stop()
        return lambda: self.writer.confirm(self.rig.shared.question)

    def run(self, ticks=20, **options):
        options = {"answered": lambda: self.shown.append(self.rig.shared.state), "confirm": True} | options
        return self.rig.run(ticks, fade=0.0, **options)

    def sent(self):
        return [(frame.time, frame.id, frame.data) for frame in self.rig.frames if frame.sent]

    def enabling(self):
        """Times in s of the frames that enable the drive or command it, also with zero torque."""
        passive = {flag(frame) for frame in (*self.drive.ask_frames(), *self.drive.set_up_frames())}
        return [time * 1e-9 for time, identifier, data in self.sent() if (identifier, data) not in passive]


class Moved(Block):
    position = Output("rad")
    velocity = Output("rad/s")

    def __init__(self, path, **options):
        self.course = path
        super().__init__(**options)

    def step(self, tick):
        return self.course(tick)


def flag(frame):
    identifier, extended, data = frame
    return identifier | (EXTENDED if extended else 0), data


@pytest.mark.hazard("H4c")
@families
def test_nothing_is_enabled_or_commanded_before_the_operator_confirms(kind, model, parameters):
    table = Operator(kind, model, parameters, {1000: "confirm"})
    outcome = table.run()
    assert (outcome.status, outcome.tick) == ("ok", 19) and table.shown == ["arming"]
    if table.drive.zero_frames() == table.drive.ask_frames():
        assert table.enabling() == [], "a board without enabling: zero current is all that it gets"
    else:
        assert 1.0 <= table.enabling()[0] < 1.05
    asked = [
        time for time, *frame in table.sent() if tuple(frame) == flag(table.drive.ask_frames()[0]) and time < 10**9
    ]
    assert len(asked) >= 195, "it is asked in every round"


@families
def test_a_run_that_is_ended_at_the_table_has_enabled_nothing(kind, model, parameters):
    table = Operator(kind, model, parameters, {1000: "stop"})
    outcome = table.run()
    assert (outcome.status, outcome.tick) == ("ok", -1) and outcome.stopped
    enables = {flag(frame) for frame in table.drive.enable_frames()}
    assert not enables & {(identifier, data) for _, identifier, data in table.sent()}
    assert not any(time < 1.0 for time in table.enabling())


@pytest.mark.hazard("H1j")
@families
@pytest.mark.parametrize("torque", [2.0, -17.0])
def test_torque_without_a_command_is_a_fault_before_the_confirmation(kind, model, parameters, torque):
    table = Operator(kind, model, parameters, {3000: "confirm"}, stray=lambda step: torque * (step >= 1000))
    outcome = table.run()
    above = abs(torque) > table.drive.torque_limit + table.drive.torque_accuracy()
    assert (outcome.culprit, outcome.tick) == ("knee", -1)
    assert outcome.status == ("excess torque" if above else "uncommanded torque")
    assert 1.0 < table.sent()[-1][0] * 1e-9 < 1.35, "with the 0.2 s of a safe stop that is not confirmed"
    enables = {flag(frame) for frame in table.drive.enable_frames()}
    assert not enables & {(identifier, data) for _, identifier, data in table.sent()}


@pytest.mark.hazard("H1j")
@families
def test_torque_without_a_command_is_a_fault_while_the_command_is_zero(kind, model, parameters):
    table = Operator(kind, model, parameters, {100: "confirm"}, stray=lambda step: 4.0 * (step >= 1000))
    outcome = table.run(400)
    if parameters.get("mode") == "velocity":
        assert outcome.status == "ok", "the intended torque is unknown"
        return
    assert (outcome.status, outcome.culprit) == ("uncommanded torque", "knee")
    begun = 0.1 + 0.1 * (kind in (CubeMarsV3, CubeMarsServo))  # arming watches for bursts of replies
    assert 1.03 < begun + outcome.tick / RATE < 1.15


def test_time_with_torque_before_the_confirmation_counts_after_it():
    table = Operator(CubeMars, "AK10-9-V2.0", {}, {1000: "confirm"}, stray=lambda step: 3.0 * (step >= 960))
    outcome = table.run()
    assert (outcome.status, outcome.tick) == ("uncommanded torque", 2), "60 ms after the first of these replies"


def test_torque_that_alternates_without_a_command_is_a_fault():
    table = Operator(CubeMars, "AK80-9", {}, {3000: "confirm"}, stray=lambda step: 5.0 * (step % 20 < 10))
    assert table.run().status == "uncommanded torque"


@pytest.mark.parametrize("torque", [0.0, 0.42, -0.42])
def test_measurement_noise_of_a_drive_at_rest_is_no_fault(torque):
    """AK80-9: 5 % of the rated torque are 0.45 N·m."""
    table = Operator(CubeMars, "AK80-9", {}, {1000: "confirm"}, stray=lambda step: torque)
    assert table.run(200).status == "ok"


@families
def test_overspeed_is_a_fault_before_the_confirmation(kind, model, parameters):
    def turns(step):
        return (0.3, 0.0) if step < 1000 else (0.3 + (step - 1000) * 6e-3, 6.0)

    table = Operator(kind, model, parameters | {"max_velocity": 5.0}, {3000: "confirm"}, joint=turns)
    outcome = table.run()
    assert (outcome.status, outcome.culprit, outcome.tick) == ("overspeed", "knee", -1)


@families
def test_joint_may_be_moved_by_hand_before_the_confirmation_but_not_armed_outside_its_range(kind, model, parameters):
    """Out of its range and back: then it is armed; left there, it is refused without being enabled."""

    def visits(step):
        """With 3 rad/s there from step 500 on, and back until step 1500."""
        way = min(max(min(step - 500, 1500 - step), 0), 400)
        return 0.3 + 3e-3 * way, 3.0 * (0 < way < 400) * (1.0 if step < 1000 else -1.0)

    inside = Operator(kind, model, parameters | {"range": (0.0, 1.0)}, {2000: "confirm"}, joint=visits)
    assert inside.run().status == "ok"
    outside = Operator(kind, model, parameters | {"range": (0.0, 1.0)}, {1000: "confirm"}, joint=visits)
    outcome = outside.run()
    assert (outcome.status, outcome.culprit, outcome.tick) == ("over-travel", "knee", -1)
    enables = {flag(frame) for frame in outside.drive.enable_frames()}
    assert not enables & {(identifier, data) for _, identifier, data in outside.sent()}


@pytest.mark.hazard("H4c")
@families
def test_nothing_is_enabled_after_a_fault_until_the_operator_arms_again(kind, model, parameters):
    """A fault of the drive from 0.5 to 0.8 s; the operator arms again at 2 s."""

    table = Operator(
        kind, model, parameters, {100: "confirm", 2000: "confirm"}, stray=lambda step: 3.5 * (500 <= step < 800)
    )
    if parameters.get("mode") == "velocity":
        pytest.skip("its torque is not judged in a run")
    outcome = table.run(600, rearm=())
    assert outcome.status == "ok" and [fault.status for fault in outcome.faults] == ["uncommanded torque"]
    passive = {flag(frame) for frame in (*table.drive.ask_frames(), *table.drive.set_up_frames())}
    passive |= {flag(frame) for frame in (*table.drive.zero_frames(), *table.drive.disable_frames())}
    waiting = [(i, d) for time, i, d in table.sent() if 0.75e9 < time < 1.999e9]
    assert waiting and set(waiting) <= passive
    assert set(waiting[60:]) == {flag(frame) for frame in table.drive.disable_frames()}


def test_torque_of_a_disabled_drive_prevents_arming_again():
    table = Operator(
        CubeMars,
        "AK10-9-V2.0",
        {},
        {100: "confirm", 1500: "confirm", 2500: "confirm"},
        stray=lambda step: 6.0 * (500 <= step < 2000),
    )
    notes = []
    outcome = table.run(600, rearm=(), notify=lambda what, outcome: notes.append((what, outcome.status)))
    assert outcome.status == "ok"
    assert notes == [("fault", "uncommanded torque"), ("refused", "uncommanded torque"), ("rearm", "ok")]


def test_drive_that_is_taken_out_and_keeps_its_torque_is_a_fault():
    with Diagram("robot", rate=RATE) as robot:
        knee = CubeMars("AK10-9-V2.0", name="knee", disabled=True)
        knee(torque_command=0.0)
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        knee.emulator(name="motor")(position=0.3, velocity=0.0, stray_torque=3.0)
    outcome = Rig(robot, plant).run(200)
    assert (outcome.status, outcome.culprit) == ("uncommanded torque", "knee") and 40 <= outcome.tick < 70


@pytest.mark.hazard("H4c")
@families
def test_nothing_is_enabled_before_an_emergency_stop_has_sent_released(kind, model, parameters):
    with Diagram("robot", rate=RATE) as robot:
        drive = kind(model, can_id=1, name="knee", **parameters)
        drive(**{"torque_command" if "torque_command" in drive.inputs else next(iter(drive.inputs)): 0.0})
        EStopHeartbeat(name="estop")
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        drive.emulator(name="motor")(position=0.3, velocity=0.0)
    rig = Rig(robot, plant)
    outcome = rig.run(20, answered=int)
    assert (outcome.status, outcome.unanswered) == ("no answer", ("estop",))
    enables = {flag(frame) for frame in drive.enable_frames()}
    assert not enables & {(frame.id, frame.data) for frame in rig.frames if frame.sent}


@pytest.mark.parametrize("kind, model", [(RobStride, "RS03"), (RobStride, "CyberGear"), (RobStrideMIT, "RS03")])
def test_drive_left_running_in_velocity_mode_is_stopped_by_the_first_frame(kind, model):
    """It turns until it is asked, and never again: its mode is written and read back before it is enabled."""
    table = Operator(kind, model, {}, {1000: "confirm"}, left_velocity=2.0)
    outcome = table.run(100)
    assert outcome.status == "ok"
    assert table.rig.frames[0].sent and (table.rig.frames[0].id, table.rig.frames[0].data) == flag(
        table.drive.ask_frames()[0]
    )
    assert max(abs(table.rig["knee.torque"])) < 0.05


@pytest.mark.hazard("H1i")
@pytest.mark.parametrize(
    "kind, parameters, ignored, words",
    [
        (RobStride, {}, "run_mode", "run_mode (0x7005) reads 2, 0 was written"),
        (RobStride, {}, "limit_torque", "limit_torque (0x700B) reads 60, 20 was written"),
        (RobStride, {}, "canTimeout", "canTimeout (0x7028) reads 0, 2000 was written"),
        (RobStride, {"mode": "velocity"}, "limit_cur", "limit_cur (0x7018) reads 43, 0 was written"),
        (RobStride, {"mode": "csp"}, "limit_spd", "limit_spd (0x7017) reads 2, 1 was written"),
        (RobStride, {"mode": "position"}, "vel_max", "vel_max (0x7024) reads 10, 1 was written"),
        (RobStride, {"mode": "position", "acceleration": 5.0}, "acc_set", "acc_set (0x7025) reads 10, 5 was written"),
        (RobStrideMIT, {}, "run_mode", "run_mode (0x7005) reads 2, 0 was written"),
        (RobStrideMIT, {}, "limit_torque", "limit_torque (0x700B) reads 0, 20 was written"),
        (RobStrideMIT, {}, "canTimeout", "canTimeout (0x7028) reads 0, 2000 was written"),
    ],
)
def test_drive_that_ignores_a_write_is_refused_with_its_value_and_never_enabled(kind, parameters, ignored, words):
    if "mode" in parameters and parameters["mode"] != "velocity":
        parameters = parameters | {"velocity_limit": 1.0}
    table = Operator(kind, "RS03", parameters, {1000: "confirm"}, left_velocity=2.0, ignores=(ignored,))
    outcome = table.run(100)
    assert (outcome.status, outcome.culprit, outcome.tick) == ("device fault", "knee", -1)
    assert words in table.drive.fault_in_words(table.rig.control.final[table.rig.schedule.signals["knee.fault"].slot])
    enables = {flag(frame) for frame in table.drive.enable_frames()}
    assert not enables & {(identifier, data) for _, identifier, data in table.sent()}


def test_settings_that_are_lost_while_the_operator_reads_the_table_are_written_again():
    """The drive loses its power at the table for 60 ms: its settings are read back once more before it is enabled."""
    with Diagram("robot", rate=RATE) as robot:
        knee = RobStride("RS03", name="knee")
        knee(torque_command=0.0)
    with Diagram("plant", rate=RATE * SUBSTEPS) as plant:
        writer = []
        off = Play(lambda step: 500 <= step < 560, {1000: lambda: writer[0].confirm(rig.shared.question)}, name="off")()
        knee.emulator(name="motor")(position=0.3, velocity=0.0, power_lost=off)
    rig = Rig(robot, plant)
    writer.append(Writer(rig.shared, "keys"))
    assert rig.run(50, answered=int, confirm=True).status == "ok"
    enable = next(k for k, frame in enumerate(rig.frames) if frame.sent and frame.id >> 24 & 31 == 3)
    late = [frame for frame in rig.frames[:enable] if frame.time > 0.99e9]
    assert {frame.id >> 24 & 31 for frame in late if not frame.sent} >= {2, 17}
