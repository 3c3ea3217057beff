"""The compiler: everything that is wrong, at once, with the block, the port, the line and the cure."""

import gc

import numpy as np
import pytest

from blocks.actuators import CubeMars
from blocks.controllers import GaitPhase, Impedance
from blocks.discrete import UnitDelay
from blocks.limiters import TorqueLimiter
from blocks.mathematics import Gain, Sum
from blocks.recorders import CsvRecorder
from blocks.sources import Sine, StepSource
from cext.kernels import mathematics
from graph import Actuator, Block, Diagram, DiagramError, Input, Kernel, Memory, Output, Param, Sink, compile, subsystem
from tests.graph.complaints import complaint, complaints, here


class Integers(Block):
    """Takes a whole number, gives one and a truth."""

    count = Input("any", dtype=int)
    twice = Output("1", dtype=int)
    positive = Output("1", dtype=bool)

    def step(self, count):
        return 2 * count, count > 0


class Flag(Block):
    """Takes a truth."""

    on = Input("1", dtype=bool, default=True)
    y = Output("1")

    def step(self, on):
        return 1.0 if on else 0.0


def test_an_unconnected_input_is_reported_where_its_block_was_made():
    with Diagram("d", rate=100) as diagram:
        with subsystem("left"):
            impedance = Impedance(name="assist")
            at = here(-1)
        impedance(position=0.1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW001", "left/assist", "velocity", at)
    assert (
        found.message == "the input is not connected and has no default [rad/s]"
        and found.hint == "wire it, as in assist(velocity=...)"
    )


def test_an_input_with_a_default_may_stay_unwired():
    with Diagram("d", rate=100) as diagram:
        Impedance()(position=0.1, velocity=0.0)
    schedule = compile(diagram)
    assert "impedance.torque" in schedule.signals


def test_an_input_wired_twice_is_reported_with_both_lines():
    with Diagram("d", rate=100) as diagram:
        gain = Gain(name="g")
        gain(Sine().y)
        first = here(-1)
        gain(1.0)
        second = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where) == ("TW004", "g", "u", second)
    assert found.message == f"is already wired at {first}" and "Sum" in found.hint


def test_an_input_given_by_place_and_by_name_is_wired_twice():
    with Diagram("d", rate=100) as diagram:
        Gain(name="g")(1.0, u=2.0)
    assert complaint(diagram).code == "TW004"


def test_an_actuator_that_is_never_commanded_is_reported():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9", name="knee")
        at = here(-1)
        Gain()(knee.position)
    found = complaint(diagram)
    assert (found.code, found.path, found.where) == ("TW005", "knee", at)
    assert found.message.startswith(
        "none of its commands is connected (position_command, velocity_command, torque_command"
    )
    assert found.hint == "connect one, as in knee(torque_command=...), or remove the actuator"


def test_a_position_command_without_stiffness_is_a_warning():
    with Diagram("d", rate=100) as diagram:
        CubeMars("AK80-9", name="knee")(position_command=0.5, torque_command=1.0)
        at = here(-1)
        CubeMars("AK80-9", can_id=2, name="hip")(position_command=Sine(unit="rad")(), stiffness_command=5.0)
        CubeMars("AK80-9", can_id=3, name="ankle")(position_command=0.0, velocity_command=0.0)
    [found] = [warning for warning in compile(diagram).warnings if warning.code == "TW027"]
    assert (found.path, found.port, found.where) == ("knee", "position_command", at)
    assert found.message == "the command has no effect, because stiffness_command is 0"


def test_two_drives_with_one_id_on_one_bus_name_each_other():
    with Diagram("d", rate=100) as diagram:
        CubeMars("AK80-9", bus="legs", can_id=3, name="a")(torque_command=0.0)
        first = here(-1)
        CubeMars("AK80-9", bus="legs", can_id=3, name="b")(torque_command=0.0)
        second = here(-1)
        CubeMars("AK80-9", bus="arms", can_id=3, name="c")(torque_command=0.0)
        CubeMars("AK80-9", bus="legs", can_id=4, name="d")(torque_command=0.0)
    found = complaint(diagram)
    assert (found.code, found.path, found.where) == ("TW013", "b", second)
    assert found.message == f"shares CAN id 3 on bus 'legs' with a, made at {first}" and "can_id" in found.hint


def test_an_id_shared_with_another_family_is_reported():
    class OtherDrive(CubeMars):
        """A lab's own driver, in a module of its own."""

    with Diagram("d", rate=100) as diagram:
        CubeMars("AK80-9", can_id=3, name="a")(torque_command=0.0)
        OtherDrive("AK80-9", can_id=3, name="b")(torque_command=0.0)
    assert complaint(diagram).code == "TW013"


def test_a_timeout_shorter_than_two_ticks_is_reported_with_one_that_works():
    def at_rate(rate, **parameters):
        with Diagram("d", rate=rate) as diagram:
            CubeMars("AK80-9", **parameters)(torque_command=0.0)
        return diagram

    found = complaint(at_rate(8))
    assert (found.code, found.path) == (
        "TW010",
        "cube_mars",
    ) and "0.1 s is shorter than two ticks at 8 Hz" in found.message
    assert found.hint == "set timeout=0.25 or more, or 0 to disable it"
    for diagram in (at_rate(20), at_rate(8, timeout=0.25), at_rate(8, timeout=0.0)):
        assert compile(diagram).devices


def test_a_loop_is_spelled_out_as_a_cycle_with_ports():
    with Diagram("d", rate=100) as diagram:
        a, b, c = Sum("++", name="a"), Gain(name="b"), Gain(name="c")
        a(Sine().y, c.y)
        at = here(-1)
        b(a.y)
        c(b.y)
        Gain(name="behind")(c.y)
    found = complaint(diagram)
    assert (found.code, found.path, found.where) == ("TW006", "a", at)
    assert found.message == "these blocks depend on each other in the same tick: a.y -> b.u, b.y -> c.u, c.y -> a.u2"
    assert "UnitDelay" in found.hint


def test_a_block_that_feeds_itself_is_a_loop():
    with Diagram("d", rate=100) as diagram:
        total = Sum("++", name="total")
        total(total.y, 1.0)
    assert complaint(diagram).message.endswith("total.y -> total.u1")


def test_every_loop_is_reported_and_only_the_shortest_cycle_of_each():
    with Diagram("d", rate=100) as diagram:
        for side in ("left", "right"):
            with subsystem(side):
                total, short = Sum("+++", name="a"), Gain(name="b")
                long = Gain(name="d")
                total(short(total.y), long(Gain(name="c")(short.y)), 1.0)
    found = complaints(diagram)
    assert [d.code for d in found] == ["TW006", "TW006"]
    assert found[0].message.endswith("left/a.y -> left/b.u, left/b.y -> left/a.u1") and "right/a" in found[1].message


def test_delays_and_inputs_without_feedthrough_open_a_loop():
    class Integrator(Block):
        """State from update alone: no feedthrough."""

        u = Input("1")
        y = Output("1")

        def reset(self):
            self.total = 0.0

        def step(self):
            return self.total

        def update(self, u):
            self.total += u

    with Diagram("d", rate=100) as diagram:
        delay, integrator = UnitDelay(), Integrator()
        delay(Gain(0.5)(delay.y))
        integrator(Gain(-1.0)(integrator.y))
    assert len(compile(diagram).output) == 4


def test_a_loop_through_an_actuator_needs_no_delay():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=TorqueLimiter(limit=5.0)(Gain(0.1)(knee.torque_sent)))
    assert [step.name for step in compile(diagram).output] == ["gain", "torque_limiter"]


@pytest.mark.parametrize(
    "source, message",
    [(2.5, "expected int, got 2.5"), (float("nan"), "expected int, got nan"), (float("inf"), "expected int, got inf")],
)
def test_a_number_that_is_not_whole_does_not_fit_a_whole_input(source, message):
    with Diagram("d", rate=100) as diagram:
        Integers(name="i")(source)
        at = here(-1)
    found = complaint(diagram)
    assert (found.code, found.path, found.port, found.where, found.message) == ("TW008", "i", "count", at, message)


def test_types_only_widen_along_a_wire():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=0.0)
        first = Integers(name="first")(knee.fault)
        Integers(name="second")(first.positive)  # a truth is a whole number
        Gain()(first.twice)  # and a whole number is a number
        Integers(name="third")(knee.position)
        at = here(-1)
        Flag(name="fourth")(first.twice)
        Flag(name="fifth")(2)
        Flag(name="sixth")(1)
        Integers(name="seventh")(StepSource().y)  # a source of anything may be a source of this
    third, fourth, fifth = complaints(diagram)
    assert (third.code, third.path, third.port, third.where) == ("TW008", "third", "count", at)
    assert third.message == "expected int, got float from cube_mars.position" and third.hint == "insert a Round"
    assert (fourth.path, fourth.message) == (
        "fourth",
        "expected bool, got int from first.twice",
    ) and "threshold" in fourth.hint
    assert (fifth.path, fifth.message) == ("fifth", "expected bool, got 2.0")


def test_a_block_without_a_step_is_reported():
    class Idle(Block):
        """Has ports and no step."""

        u = Input("1")
        y = Output("1")

    class OnlyUpdates(Idle):
        """Has an output that nothing gives a value."""

        def update(self, u):
            pass

    with Diagram("d", rate=100) as diagram:
        Idle()(1.0)
        OnlyUpdates()(1.0)
    idle, only = complaints(diagram)
    assert (idle.code, idle.message, idle.hint) == (
        "TW015",
        "Idle has neither a step nor a kernel",
        "define step(self, u)",
    )
    assert (only.code, only.path) == ("TW015", "only_updates")


def test_eight_different_errors_give_eight_diagnostics():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK10-9-V2.0", can_id=1, name="knee")
        CubeMars("AK10-9-V2.0", can_id=1, name="shared")(torque_command=0.0)
        CubeMars("AK10-9-V2.0", can_id=2, name="idle")
        Impedance(name="open")(position=0.0)
        Impedance(name="units")(position=knee.velocity, velocity=0.0)
        Impedance(name="shapes")(position=[0.0, 1.0], velocity=0.0)
        twice = Gain(name="twice")
        twice(1.0), twice(2.0)
        loop = Gain(name="loop")
        loop(loop.y)
        knee(torque_command=Impedance(name="free")(knee.position, knee.velocity))
    found = {(d.code, d.path, d.port) for d in complaints(diagram)}
    assert found == {
        ("TW013", "shared", ""),
        ("TW005", "idle", ""),
        ("TW001", "open", "velocity"),
        ("TW002", "units", "position"),
        ("TW003", "shapes", "position"),
        ("TW004", "twice", "u"),
        ("TW006", "loop", ""),
        ("TW007", "knee", "torque_command"),
    }


def test_an_unused_block_is_a_warning_unless_everything_is_recorded():
    with Diagram("d", rate=100) as diagram:
        Sine(name="lonely")
        at = here(-1)
    (warning,) = compile(diagram).warnings
    assert (warning.code, warning.path, warning.where, warning.severity) == ("TW020", "lonely", at, "warning")
    with diagram:
        CsvRecorder()
    assert compile(diagram).warnings == []


def test_a_block_that_enables_a_subsystem_is_used():
    with Diagram("d", rate=100) as diagram, subsystem("assist", enabled=StepSource(name="switch")()):
        Gain(name="lonely")(1.0)
    assert [warning.path for warning in compile(diagram).warnings] == ["assist/lonely"]


def test_a_connected_sink_receives_only_its_signals_with_labels():
    with Diagram("d", rate=100) as diagram:
        sine = Sine().y
        Gain()(sine)
        CsvRecorder(name="some")(sine, doubled=Gain(2.0, name="twice")(sine))
    schedule = compile(diagram)
    assert [column.path for column in schedule.sinks[0].columns] == ["sine.y", "doubled"]
    assert [d.path for d in schedule.warnings] == ["gain"]
    assert len(schedule.columns) == 2


def test_vector_columns_carry_their_index():
    class Triple(Block):
        """A vector."""

        y = Output("m/s²", shape=(3,))

        def step(self):
            return 1.0, 2.0, 3.0

    with Diagram("d", rate=100) as diagram:
        Triple(name="imu")
        CsvRecorder()
    columns = compile(diagram).sinks[0].columns
    assert [(column.path, column.unit) for column in columns] == [(f"imu.y[{i}]", "m/s²") for i in range(3)]


def test_an_empty_diagram_compiles():
    schedule = compile(Diagram("nothing", rate=100))
    assert schedule.output == [] and schedule.signals == {} and schedule.gil_sections == 0


def test_errors_are_listed_in_file_order():
    with Diagram("d", rate=100) as diagram:
        Sum("++", name="z")(1.0)
        CubeMars("AK80-9", name="m")
        Sum("++", name="a")(1.0)
    assert [d.path for d in complaints(diagram)] == ["z", "m", "a"]


def test_compiling_twice_gives_the_same_schedule():
    with Diagram("d", rate=100) as diagram:
        knee = CubeMars("AK80-9")
        knee(torque_command=TorqueLimiter(limit=5.0)(knee.torque))
        CsvRecorder()
    first, second = compile(diagram), compile(diagram)
    assert [s.table for s in first.output] == [s.table for s in second.output] and np.array_equal(
        first.arena, second.arena, equal_nan=True
    )
    assert first.parameters == second.parameters and first.signals == second.signals


def test_parameters_of_native_blocks_have_their_slot():
    with Diagram("d", rate=100) as diagram, subsystem("left"):
        Impedance(stiffness=40.0)(0.0, 0.0)
    schedule = compile(diagram)
    assert schedule.arena[schedule.parameters["left/impedance.stiffness"]] == 40.0
    assert set(schedule.parameters) == {"left/impedance.stiffness", "left/impedance.damping"}


def test_adjacent_python_steps_share_one_acquisition_of_the_gil():
    class Half(Block):
        """A Python block."""

        u = Input("any")
        y = Output("any")

        def step(self, u):
            return 0.5 * u

    with Diagram("d", rate=100) as diagram:
        for _ in range(5):
            Half()(Gain()(Half()(Gain()(Sine().y))))
    assert compile(diagram).gil_sections == 2


def test_slow_blocks_are_adjacent_after_their_sources():
    with Diagram("d", rate=100) as diagram:
        signal = Sine().y
        Gain(every=4, name="slow")(Gain(every=2, name="half")(Gain(name="fast")(signal)))
    assert [(step.name, step.every) for step in compile(diagram).output] == [
        ("sine", 1),
        ("fast", 1),
        ("half", 2),
        ("slow", 4),
    ]


def test_hooks_of_devices_that_raise_are_reported_with_their_line():
    class Broken(Actuator):
        """Its limits make no sense."""

        torque_command = Input("N·m", default=0.0)
        age = Output("s")
        decode = encode = Kernel(None, "")

        def command_limits(self):
            raise ValueError("no limits are known of this one")

    with Diagram("d", rate=100) as diagram:
        Broken(name="b")(torque_command=0.0)
    found = complaint(diagram)
    assert (found.code, found.path, found.message) == ("TW010", "b", "no limits are known of this one")


def test_a_new_device_class_has_no_limits_frames_or_emulator_by_default():
    class Lamp(Actuator):
        """The least that an actuator can be."""

        level_command = Input("1", default=0.0)

    lamp = Lamp()
    assert lamp.command_limits() == {} and lamp.rating() == "" and lamp.addresses() == []
    assert lamp.enable_frames() == lamp.zero_frames() == lamp.disable_frames() == []
    with pytest.raises(TypeError, match="Lamp has no emulator"):
        lamp.emulator()


def test_memory_of_any_length_is_placed():
    class Buffered(Gain):
        """Asks for memory that depends on the rate."""

        buffer = Memory(0.0)
        kernel = mathematics.gain

        def prepare(self, dt):
            self.buffer = [0.0] * round(1.0 / dt)

    with Diagram("d", rate=50) as diagram:
        Buffered()(1.0)
    assert compile(diagram).items["buffered"]["buffer"][1] == 50


def test_a_sink_with_required_inputs_must_be_connected():
    class Gauge(Sink):
        """Shows an angle."""

        variadic = False
        angle = Input("rad")

    with Diagram("d", rate=100) as diagram:
        Gauge(name="open")
        Gauge(name="wrong")(GaitPhase()(0.0, 0.0).phase)
    assert [(d.code, d.path) for d in complaints(diagram)] == [("TW001", "open"), ("TW002", "wrong")]


@pytest.mark.parametrize("collecting", [True, False])
def test_garbage_collection_is_off_during_compile_and_restored(collecting):
    seen = []

    class Watcher(Block):
        y = Output("1")

        def prepare(self, dt):
            seen.append(gc.isenabled())

        def step(self):
            return 0.0

    with Diagram("d", rate=100) as diagram:
        Gain()(Watcher().y)
        CsvRecorder()
    with Diagram("wrong", rate=100) as wrong:
        Gain()
    before = gc.isenabled()
    try:
        (gc.enable if collecting else gc.disable)()
        compile(diagram)
        with pytest.raises(DiagramError):
            compile(wrong)
        assert gc.isenabled() == collecting and seen[-1] is False
    finally:
        (gc.enable if before else gc.disable)()


class Modem(Block):
    """Has a bitrate, and is not a device on a bus."""

    bitrate = Param(9600.0, "1/s", min=0.0)
    y = Output("1")

    def step(self):
        return self.bitrate


def test_a_block_that_is_not_a_device_may_have_a_parameter_named_bitrate():
    with Diagram("modems", rate=100) as diagram:
        CsvRecorder()(Modem().y, Modem(bitrate=19200.0).y)
    assert compile(diagram).warnings == []
