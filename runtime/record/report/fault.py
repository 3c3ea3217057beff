"""Explanation of a fault: block, status, values, and the line in the user's file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from cext.safety.suspend import time_suspended, was_paused
from cext.safety.thresholds import PAGE_SILENCE
from cext.user_text import last_lines
from graph import Device
from graph.device import UNIT_EXPECTED, actuators_of
from graph.signal import Signal
from runtime.host.system import read
from runtime.record.report import drive_faults, fault_context, lost_replies
from runtime.record.report.lost_ticks import before_fault
from runtime.record.report.timing import micro
from runtime.robot.loading import hints
from runtime.robot.loading.file import own_frames, words

if TYPE_CHECKING:
    import numpy as np

    from cext.memory.shared_state import SharedState
    from cext.schedule.outcome import Outcome
    from cext.schedule.program import Program
    from graph import Block, Diagram, Schedule
    from runtime.record.report.run_result import RunResult
    from runtime.robot.rig.buses import RigBuses


CALL_LIMIT = 20  # lines of the calls of an exception
KERNEL_STATUS = "kernel status"  # start of the name of a status that is the block's own


def explain(result: RunResult) -> list[str]:
    """Return the lines that explain the fault of a run."""
    outcome = result.outcome
    diagram, schedule, program = result.diagram, result.schedule, result.control
    if result.failed_in_plant:
        diagram, schedule, program = result.simulation.diagram, result.simulation.plant, result.simulation.program
    block = diagram.blocks.get(outcome.culprit or "")
    where = f" of {diagram.name}, the plant" if result.failed_in_plant else ""
    lines = [
        f"FAULT at {outcome.culprit or diagram.name}{where}, {_when(result)}: "
        f"{what(result, block, program)}{lost_replies.before_fault(result)}"
        f"{lost_replies.also_silent(result)}{before_fault(result)}"
    ]
    if block is not None:
        lines += [f"  {line}" for line in circumstances(outcome, diagram, schedule, program, block)]
    if outcome.error is not None:
        lines += [f"  {line}" for line in own_traceback(result.request.file, outcome.error)]
    if outcome.status == "bus error" and result.rig is not None:
        lines += [f"  {line}" for line in result.rig.explain(outcome.culprit)]
    if result.rig is not None and result.rig.lost:
        lines += [f"  {line}" for line in closed_descriptors(result.rig)]
    if not result.failed_in_plant:
        lines += [f"  {line}" for line in fault_context.ticks(result, block)]
    if has_actuators(result):
        lines += [f"  {line}" for line in fault_context.actuators(result)]
        lines.append("  actuators stay disabled until the next arming: fix the cause, then arm again")
    return lines


def has_actuators(result: RunResult) -> bool:
    """Return whether the robot has actuators, which a fault stops."""
    return bool(actuators_of(result.diagram))


def _when(result: RunResult) -> str:
    tick = result.outcome.tick
    return f"tick {tick} ({tick / result.schedule.rate:g} s)" if tick >= 0 else "while arming"


class Case(NamedTuple):
    """A fault, and the block in which it arose, if any. program : of the diagram with the block, robot or plant"""

    result: RunResult
    block: Block | None
    program: Program


def what(result: RunResult, block: Block | None, program: Program) -> str:
    """Return the fault as text.

    block : block in which the fault arose, or None
    program : program of the diagram with the block: the robot or its plant
    """
    status = result.outcome.status
    text = TEXTS.get(status, "")
    return (
        (text if isinstance(text, str) else text(Case(result, block, program)))
        or drive_faults.text(status, block, program)
        or kernel_fault(status, block)
        or f"ended with status {status!r}"
    )


def kernel_fault(status: str, block: Block | None) -> str:
    """Return the block's own text for a status of its kernel, or ""."""
    words, _, number = status.rpartition(" ")
    return block.fault_text(int(number)) if block is not None and words == KERNEL_STATUS else ""


def unclear(result: RunResult) -> str:
    """Return why the positions of joints are ambiguous."""
    poses = getattr(result, "poses", None)
    return (
        "; ".join(poses.refusals.values())
        if poses is not None
        else "a joint may be at another position than its drive reports"
    )


def exception_text(outcome: Outcome) -> str:
    """Return the text for an exception of a Python block, or for its exit from the program.

    An exception is a defect; an exit is not, but ends the run with the same safe stop.
    """
    error = outcome.error
    leaves = isinstance(error, (SystemExit, KeyboardInterrupt))
    return f"its step exited the program ({words(error)})" if leaves else "its step raised an exception"


def highest_text(case: Case, what: str, unit: str) -> str:
    """Return the highest monitored value as text, such as ': 9.1 N·m'; '' without one.

    what : key in DeviceReports.watched
    """
    path = None if case.block is None else case.block.path
    return next((f": {row[what]:.1f} {unit}" for row in case.program.reports.watched if row["device"] == path), "")


def silent(result: RunResult, block: Block | None) -> str:
    """Return for how long a device did not reply, and what was received instead."""
    timeout = f" ({block.timeout:g} s)" if isinstance(block, Device) else ""
    if isinstance(block, Device) and block.medium == "stream" and result.rig is not None:
        timeout += f"; {result.rig.line(block.bus)}"
    words = (
        fault_context.malformed_frames(result, block)
        if isinstance(block, Device) and not result.failed_in_plant
        else ""
    )
    instead = f"; {words}" if words else ""
    restart = getattr(block, "restart_time", 0.0)
    if not 0.0 < restart < getattr(block, "timeout", 0.0):
        return f"no reply for longer than its timeout{timeout}{instead}"
    return (
        f"no reply for longer than its restart_time ({restart:g} s, or two periods): it may have restarted, and it "
        "would obey the next command without an enable, at an angle that may have shifted. Check its supply and the "
        "bus. A USB adapter that delivers replies in bursts has the same effect: set its latency timer to 1 ms, or use "
        "an interface with native SocketCAN. If the drive was measured to need longer to restart, set restart_time to "
        f"that{instead}"
    )


def silent_devices_text(result: RunResult) -> str:
    """Return the text on the devices that did not reply, and what was received instead."""
    silent = [result.diagram[path] for path in result.outcome.unanswered]
    names = ", ".join(f"{block.path} ({where_it_is(block, result.rig)})" for block in silent)
    instead = [f"{block.path}: {words}" for block in silent if (words := fault_context.instead(result, block))]
    if len(instead) == len(silent):
        return f"no reply from {names}; {'; '.join(instead)}"
    return f"no reply from {'; '.join([names, *instead, *frames_received(result.statistics)])}" + (
        on_the_rig(result.rig) if result.rig is not None else not_emulated(result, silent)
    )


def not_emulated(result: RunResult, silent: Iterable[Device]) -> str:
    """Return the remedy for devices that the plant does not emulate, as text; "" if it emulates all of them."""
    plant = [each for each in result.simulation.diagram or () if isinstance(each, Device)]
    calls = ", ".join(
        f'robot["{block.path}"].emulator()'
        for block in silent
        if type(block).emulator is not Device.emulator
        and not any(each.bus == block.bus and set(each.addresses()) >= set(block.addresses()) for each in plant)
    )
    return f"; add {calls} to the plant" if calls else ""


def frames_received(statistics: Mapping[str, Any]) -> list[str]:
    """Return the number of received frames, as a list of one text; empty if they were not counted."""
    if "frames" not in statistics:
        return []
    received, foreign = (statistics["frames"][kind] for kind in ("received", "foreign"))
    return [
        f"{received} frames were received, {foreign} of them with an unknown ID"
        if received
        else "no frame was received on any bus"
    ]


def where_it_is(block: Device, rig: RigBuses | None) -> str:
    """Return the bus and address of a device, or the serial line and its state."""
    if block.medium == "stream":
        return f"on {block.bus}" + (f", {rig.line(block.bus)}" if rig is not None else "")
    what = "id" if block.medium == "can" else "address"
    return (
        ", ".join(f"{what} {each} on bus {block.bus}" for each in block.displayed_addresses()) or f"on bus {block.bus}"
    )


def on_the_rig(rig: RigBuses) -> str:
    """Return what the buses report about missing replies."""
    words = [f" (unknown IDs on {name}: {', '.join(ids)})" for name, ids in rig.strangers().items()]
    words += [
        f"; no node acknowledges frames on {channel}: check drive power, wiring, termination and bitrate"
        for channel in rig.unheard()
    ]
    words += [f"; {path} failed {counts['failures']} times: {why}" for path, counts, why in rig.failures()]
    return "".join(words)


def fenced_text(result: RunResult) -> str:
    """Return how long the control loop had stalled when the guardian fenced the run."""
    stop = result.rig.report["stop"] if result.rig is not None else None
    if stop is None and result.rig is not None and result.rig.lost:
        return "stopped by the guardian, because the control process has closed its connection"
    if stop is None:
        return "fenced by the guardian, which left no report of the reason"
    if stop["because"] == "torque":
        return f"fenced by the guardian: {stop['excess']}"
    return f"fenced by the guardian: the control loop had stalled for {stop['silent'] * 1e3:.0f} ms"


def closed_descriptors(rig: RigBuses) -> list[str]:
    """Return lines on the file descriptors of the run that code of its process has closed or replaced."""
    return [
        f"file descriptors of the run were closed or replaced: {', '.join(rig.lost)}",
        "a block, or a library that it uses, calls os.closerange or os.dup2, or detaches itself from the terminal: "
        "remove that call, or make it in another process",
    ]


def unguarded_text(result: RunResult) -> str:
    """Return how the guardian ended, and how the motors were stopped without it."""
    if result.rig is None:
        return "the guardian is not running"
    report = result.rig.report
    why = ", and actuators run only under its supervision" * has_actuators(result)
    how = f"the guardian does not respond{why} (process {result.rig.guardian.pid}, {report['died']})"
    if "taken_over" not in report:
        return how
    unopened = "".join(f"; {bus} could not be opened: {why}" for bus, why in report["troubles"].items())
    return f"{how}{'; the control process stopped the motors' * has_actuators(result)}{unopened}"


def suspended_text(result: RunResult) -> str:
    """Return how long the computer or the run was suspended, and the commands of the drives meanwhile."""
    seconds = 0.0 if result.shared is None else time_suspended(result.shared) * 1e-9
    paused = result.shared is not None and was_paused(result.shared)
    what = "every process of the run was paused" if paused else "the computer was suspended"
    drives = (
        ". The drives kept their last command meanwhile, unless they have a time-out, and were stopped when it resumed"
    )
    return f"{what} for {seconds:.1f} s{drives * has_actuators(result)}"


def lost_page_text(shared: SharedState | None) -> str:
    """Return which page with the controls was lost, and why."""
    page, why, taker = (0, "", 0) if shared is None else shared.lost_page
    if shared is None or not why:
        return "the page with the controls was lost"
    words = {
        "silent": f"{PAGE_SILENCE * 1e-6:g} ms without a reply from page {page}: {silence_of(shared.page_process)}",
        "closed": f"page {page} was closed or reloaded",
        "cut": f"the connection of page {page} was cut, or its browser has died",
        "taken": f"page {taker} took the controls from page {page}",
        "returned": f"page {page} gave the controls back",
        "ended": f"the process of the panel ended, and with it page {page}",
    }
    return f'{words[why]}. It had the controls, and the Panel has lost="stop"'


def silence_of(panel: int) -> str:
    """Return why a page may not have replied. panel : ID of the process of the panel"""
    state = read(f"/proc/{panel}/stat").rpartition(")")[2].split()[:1]
    if state in ([], ["Z"], ["X"]):
        return "the process of the panel has died"
    if state in (["T"], ["t"]):
        return "the process of the panel is paused"
    return "its link is lost or slow, or its browser or computer is paused, busy or asleep"


def two_devices(case: Case) -> str:
    """Return which id two devices answer to, and the remedy."""
    block = case.block
    if not isinstance(block, Device):
        return "two devices answer to one id"
    ids = ", ".join(str(identifier) for identifier, _ in block.addresses())
    unique = case.result.schedule.items.get(block.path, {}).get("unique")
    if unique is not None and case.program.values[unique[0]] >= UNIT_EXPECTED:
        return (
            f"another unit than the recorded one, or a second device, responds as id {ids} on bus {block.bus}. Mount "
            "the recorded unit, or run the command `commission` with this one, then start the run again"
        )
    return (
        f"two devices have id {ids} on bus {block.bus}, or another controller commands it: {shown_by(block)}. Connect "
        "the devices one at a time, and set an id of its own in each with `configure`"
    )


def shown_by(block: Device) -> str:
    """Return how two devices with the id of a block are detected."""
    replies = block.command_replies()
    if replies is not None and replies.report_rate > 0.0:
        return (
            f"more reports than its report_rate of {replies.report_rate:g} Hz allows. If its rate was changed with the "
            "vendor's tool, pass it as report_rate"
        )
    if "unique" in block.memory:
        return "more replies than frames to it, or two unique numbers"
    return (
        "more replies than frames to it. A drive that also reports by itself needs its report_rate"
        * ("report_rate" in block.parameters)
        or "more replies than frames to it"
    )


def foreign_command(block: Block | None) -> str:
    """Return which drive received a command from another node."""
    if not isinstance(block, Device):
        return "another node on the bus commands its actuators"
    ids = ", ".join(str(identifier) for identifier, _ in block.addresses())
    return f"another node commands it: a frame to id {ids} on bus {block.bus} that this run did not send"


def hung(result: RunResult) -> str:
    """Return the text on a step that hung: its duration, and how it ended."""
    outcome, stopped = result.outcome, "; the motors were stopped meanwhile" * has_actuators(result)
    end = "until the watchdog interrupted it" if isinstance(outcome.error, KeyboardInterrupt) else "before it returned"
    return f"it hung: its step ran for {micro(outcome.hung)} {end}{stopped}"


def overran(result: RunResult) -> str:
    """Return the number of missed grid points, and the longest time of the step that caused them."""
    row = next((row for row in result.overruns if row["name"] == result.outcome.culprit), None)
    took = f"it took {micro(row['longest'])} (tick {row['at_tick']}); " if row else ""
    missed = f"{result.statistics['missed']} grid points were missed in total"
    return f"{took}{missed}, more than --overrun {result.request.overrun} allows"


TEXTS: dict[str, str | Callable[[Case], str]] = {  # of each status of an Outcome; drive_faults.WORDS has the monitor's
    "not finite": lambda case: (
        "its emulated reply contains NaN or infinity" if case.result.failed_in_plant else "a command is NaN or infinite"
    ),
    "out of limits": "a command is outside the proved interval",
    "exception": lambda case: exception_text(case.result.outcome),
    "no answer": lambda case: silent_devices_text(case.result),
    "silent": lambda case: silent(case.result, case.block),
    "device fault": "the device reports a fault",
    "bus error": "the bus can neither send nor receive",
    "overrun": lambda case: overran(case.result),
    "fenced": lambda case: fenced_text(case.result),
    "unguarded": lambda case: unguarded_text(case.result),
    "foreign command": lambda case: foreign_command(case.block),
    "rms torque": lambda case: "RMS torque exceeds the rated torque" + highest_text(case, "rms", "N·m"),
    "too hot": lambda case: "the temperature exceeds its limit" + highest_text(case, "temperature", "°C"),
    "e-stop": "the emergency stop was pressed",
    "hung": lambda case: hung(case.result),
    "unclear pose": lambda case: unclear(case.result),
    "two devices": two_devices,
    "program silent": "a pass of the connected program's loop took longer than its loop_timeout: raise loop_timeout, "
    "or move what takes long to another thread",
    "page lost": lambda case: lost_page_text(case.result.shared),
    "suspended": lambda case: suspended_text(case.result),
}


def circumstances(outcome: Outcome, diagram: Diagram, schedule: Schedule, program: Program, block: Any) -> list[str]:
    """Return lines with the inputs of the failed block and the values that are out of range."""
    inputs = program.inputs(block.path)
    lines = []
    if outcome.status in ("exception", "not finite", "out of limits", "hung") and inputs:
        lines.append("its inputs: " + ", ".join(f"{name} = {value:g}" for name, value in inputs.items()))
    if outcome.status == "hung" and outcome.error is None:
        lines.append(f"created at {block.location}")
    if outcome.status == "out of limits":
        for name, limit in block.command_limits().items():
            if inputs.get(name) not in limit:
                unit = block.inputs[name].unit
                lines.append(
                    f"{name} = {inputs[name]:g} is outside {limit} {unit}: a block upstream exceeds the range that "
                    "it declares"
                )
    if outcome.status == "not finite":
        source = origin(diagram, schedule, program.final, block)
        if source is not None:
            given = ", ".join(f"{name} = {value:g}" for name, value in program.inputs(source.block.path).items())
            value = first_non_finite(signal_values(schedule, program.final, source))
            lines.append(
                f"first non-finite signal: {source.path} = {value:g}, created at {source.block.location}"
                + (f", with inputs {given}" if given else "")
            )
    if outcome.status == "device fault":
        outputs = {name: program.final[schedule.signals[Signal(block, name).path].slot] for name in block.outputs}
        message = ", ".join(
            f"{name} = {int(value)}" if block.outputs[name].dtype == "int" else f"{name} = {value:g}"
            for name, value in outputs.items()
        )
        lines.append(f"reported fault: {block.fault_in_words(int(outputs['fault']))} ({message})")
    return lines


def origin(diagram: Diagram, schedule: Schedule, values: np.ndarray, block: Block) -> Signal | None:
    """Return the non-finite signal upstream of a block whose own block has only finite inputs.

    Infinities count like NaN, since a limiter turns an infinity into NaN. Returns None if every input of the block is
    finite, and the last signal of the search if every signal of a loop is non-finite.

    values : values of the arena, at the end of the tick
    """
    wires = {}
    for wire in diagram.wires:
        if isinstance(wire.source, Signal):
            wires.setdefault(wire.block, []).append(wire.source)

    def non_finite(at):
        measures = isinstance(at, Device) and at is not block  # its inputs are of the end of the tick
        return (
            []
            if measures
            else [
                signal
                for signal in wires.get(at, ())
                if not all(map(math.isfinite, signal_values(schedule, values, signal)))
            ]
        )

    candidate, waiting, seen = None, non_finite(block), {block}
    while waiting:
        candidate = waiting.pop(0)
        before = non_finite(candidate.block)
        if not before:
            break
        if candidate.block not in seen:
            seen.add(candidate.block)
            waiting += before
    return candidate


def signal_values(schedule: Schedule, values: np.ndarray, signal: Signal) -> np.ndarray:
    """Return the elements of a signal, as a flat array. values : values of the arena"""
    place = schedule.signals[signal.path]
    return values[place.slot : place.slot + place.size]


def first_non_finite(elements: Iterable[float]) -> float:
    """Return the first non-finite element."""
    return next(value for value in elements if not math.isfinite(value))


def own_traceback(file: Path, error: BaseException) -> list[str]:
    """Return the lines of an exception that are in the user's files, then its message."""
    # the watchdog raises KeyboardInterrupt, not the block
    message = [] if isinstance(error, KeyboardInterrupt) else [*last_lines(error), hints.hint(file, error)]
    calls = [f"{frame.filename}:{frame.lineno} in {frame.name}: {frame.line}" for frame in own_frames(file, error)]
    if len(calls) > CALL_LIMIT:  # of a recursion
        half = CALL_LIMIT // 2
        calls[half:-half] = [f"... {len(calls) - 2 * half} further calls"]
    return [*calls, *filter(None, message)]
