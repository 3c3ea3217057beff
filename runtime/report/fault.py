"""What went wrong in a run, for whoever has to mend it: where, with which numbers, in which line of theirs."""

import math

from graph import Device
from graph.signal import Signal
from runtime.base.exception_text import last_lines
from runtime.diagrams.file import own_frames, words
from runtime.report import drive_faults, fault_context
from runtime.report.lost_ticks import before_fault
from runtime.report.timing import micro


def explain(result):
    """Lines about a fault."""
    outcome = result.outcome
    diagram, schedule, program = result.diagram, result.schedule, result.control
    if result.failed_in_plant:
        diagram, schedule, program = result.simulation.diagram, result.simulation.plant, result.simulation.program
    block = diagram.blocks.get(outcome.culprit)
    where = f" of {diagram.name}, the plant" if result.failed_in_plant else ""
    lines = [
        f"FAULT at {outcome.culprit or diagram.name}{where}, {when(result)}: "
        f"{what(result, block, program)}{before_fault(result)}"
    ]
    if block is not None:
        lines += [f"  {line}" for line in circumstances(outcome, diagram, schedule, program, block)]
    if outcome.error is not None:
        lines += [f"  {line}" for line in own_traceback(result.request.file, outcome.error)]
    if outcome.status == "bus error" and result.rig is not None:
        lines += [f"  {line}" for line in result.rig.explain(outcome.culprit)]
    if not result.failed_in_plant:
        lines += [f"  {line}" for line in fault_context.ticks(result, block)]
    if schedule.devices:
        lines += [f"  {line}" for line in fault_context.actuators(result)]
        lines.append("  nothing re-enables an actuator by itself: mend it, and arm again")
    return lines


def when(result):
    tick = result.outcome.tick
    return f"tick {tick} ({tick / result.schedule.rate:g} s)" if tick >= 0 else "while arming"


def what(result, block, program):
    """The fault in words."""
    outcome = result.outcome
    timeout = f" ({block.timeout:g} s)" if isinstance(block, Device) else ""
    if isinstance(block, Device) and block.medium == "stream" and result.rig is not None:
        timeout += f"; {result.rig.line(block.bus)}"
    return (
        {
            "not finite": "a command is NaN or infinite"
            if not result.failed_in_plant
            else "what it would answer is NaN or infinite",
            "out of limits": "a command has left the interval that was proved",
            "exception": raised(outcome),
            "no answer": unanswered(result),
            "silent": f"no reply for longer than its timeout{timeout}" + read_instead(result, block),
            "device fault": "the device reports a fault",
            "bus error": "the bus can neither send nor receive",
            "overrun": overran(result),
            "fenced": fenced(result),
            "unguarded": unguarded(result),
            "foreign command": foreign_command(block),
            "rms torque": "its RMS torque is above the rated one" + seen(program, block, "rms", "N·m"),
            "too hot": "it is too hot" + seen(program, block, "temperature", "°C"),
            "e-stop": "the emergency stop was pressed",
            "hung": hung(outcome),
            "unclear pose": unclear(result),
        }.get(outcome.status)
        or drive_faults.text(outcome.status, block, program)
        or f"it ended with {outcome.status}"
    )


def unclear(result):
    """Which joints may stand elsewhere than their drives read."""
    return (
        "; ".join(result.poses.refusals.values())
        if getattr(result, "poses", None) is not None
        else "a joint may stand elsewhere than its drive reads"
    )


def raised(outcome):
    """What a Python block did: an exception is a bug, leaving the program is not one but ends the run just as
    safely.
    """
    leaves = isinstance(outcome.error, (SystemExit, KeyboardInterrupt))
    return f"it left the program ({words(outcome.error)})" if leaves else "its step raised an exception"


def seen(program, block, what, unit):
    """': 9.1 N·m' of what the watch has seen at its most."""
    return next(
        (f": {row[what]:.1f} {unit}" for row in program.watched if block is not None and row["device"] == block.path),
        "",
    )


def unanswered(result):
    """Who did not answer, and what was heard instead."""
    silent = [result.diagram[path] for path in result.outcome.unanswered]
    names = ", ".join(f"{block.path} ({where_it_is(block, result.rig)})" for block in silent)
    instead = [f"{block.path}: {words}" for block in silent if (words := fault_context.instead(result, block))]
    if len(instead) == len(silent):
        return f"no answer from {names}; {'; '.join(instead)}"
    heard, strangers = (result.statistics["frames"][kind] for kind in ("received", "foreign"))
    frames = (
        f"{heard} frames were heard, {strangers} of them for nobody here" if heard else "nothing was heard on any bus"
    )
    return f"no answer from {names}; {'; '.join([*instead, frames])}" + (
        on_the_rig(result.rig) if result.rig is not None else ""
    )


def read_instead(result, block):
    """'; 20 replies of 7 bytes' of a device that fell silent."""
    words = fault_context.rejected(result, block) if isinstance(block, Device) and not result.failed_in_plant else ""
    return f"; {words}" if words else ""


def where_it_is(block, rig):
    """On which bus a device is, and as whom; of one with a line of its own, which that is and whether it is there."""
    if block.medium == "stream":
        return f"on {block.bus}" + (f", {rig.line(block.bus)}" if rig is not None else "")
    what = "id" if block.medium == "can" else "address"
    return ", ".join(f"{what} {each} on bus {block.bus}" for each in block.told_addresses()) or f"on bus {block.bus}"


def on_the_rig(rig):
    """What the buses themselves know of why nobody answered."""
    words = [f" (on {name} ids {', '.join(ids)})" for name, ids in rig.strangers().items()]
    words += [
        f"; nobody acknowledges a frame on {channel}: drives without power, a wire, a terminator, the bitrate"
        for channel in rig.unheard()
    ]
    words += [f"; {path} failed {told['failures']} times: {why}" for path, told, why in rig.failures()]
    return "".join(words)


def fenced(result):
    """What the guardian saw."""
    stop = result.rig.report["stop"] if result.rig is not None else None
    if stop is None:
        return "the run was fenced by another process"
    return f"fenced by the guardian: the loop had stood still for {stop['silent'] * 1e3:.0f} ms"


def unguarded(result):
    """How the guardian ended, and what was done without it."""
    if result.rig is None:
        return "there is no guardian"
    report = result.rig.report
    how = (
        f"the guardian did not answer, and nothing moves without it (process {result.rig.guardian.pid}, "
        f"{report['died']})"
    )
    if "taken_over" not in report:
        return how
    unopened = "".join(f"; {bus} could not be opened: {why}" for bus, why in report["troubles"].items())
    return f"{how}; the motors were stopped from here{unopened}"


def foreign_command(block):
    """Who was commanded by somebody else."""
    if not isinstance(block, Device):
        return "somebody else commands its actuators"
    ids = ", ".join(str(identifier) for identifier, _ in block.addresses())
    return f"somebody else commands it: a frame to id {ids} on bus {block.bus} that this run did not send"


def hung(outcome):
    """How long a tick worked, and how it came to an end."""
    broken = "until it was broken off" if isinstance(outcome.error, KeyboardInterrupt) else "before it came back"
    return f"it hung: {micro(outcome.hung)} of work {broken}; the motors were stopped meanwhile"


def overran(result):
    """What was missed, and the time that it took."""
    row = next((row for row in result.overruns if row["name"] == result.outcome.culprit), None)
    took = f"it took {micro(row['longest'])} (tick {row['at_tick']}); " if row else ""
    missed = f"{result.statistics['missed']} grid points were missed in all"
    return f"{took}{missed}, which is more than --overrun {result.request.overrun} allows"


def circumstances(outcome, diagram, schedule, program, block):
    """The numbers at the block that failed, and what is odd about them."""
    inputs = program.inputs(block.path)
    lines = []
    if outcome.status in ("exception", "not finite", "out of limits", "hung") and inputs:
        lines.append("its inputs: " + ", ".join(f"{name} = {value:g}" for name, value in inputs.items()))
    if outcome.status == "hung" and outcome.error is None:
        lines.append(f"it was made at {block.location}")
    if outcome.status == "out of limits":
        for name, limit in block.command_limits().items():
            if inputs.get(name) not in limit:
                unit = block.inputs[name].unit
                lines.append(
                    f"{name} = {inputs[name]:g} is outside {limit} {unit}: a block upstream promises a "
                    "range it does not keep"
                )
    if outcome.status == "not finite":
        source = origin(diagram, schedule, program.final, block)
        if source is not None:
            given = ", ".join(f"{name} = {value:g}" for name, value in program.inputs(source.block.path).items())
            value = worst(signal_values(schedule, program.final, source))
            lines.append(
                f"it arose in {source.path} = {value:g}, made at {source.block.location}"
                + (f", from {given}" if given else "")
            )
    if outcome.status == "device fault":
        outputs = {name: program.final[schedule.signals[Signal(block, name).path].slot] for name in block.outputs}
        said = ", ".join(
            f"{name} = {int(value)}" if block.outputs[name].dtype == "int" else f"{name} = {value:g}"
            for name, value in outputs.items()
        )
        lines.append(f"it says: {block.fault_in_words(int(outputs['fault']))} ({said})")
    return lines


def origin(diagram, schedule, values, block):
    """The signal upstream of a block that is NaN or infinite although every input of its own block is finite.

    A limiter makes NaN of an infinity, so both count. None where every input of the block is finite. Of a loop in which
    no signal is finite any more, the last one that was looked at.
    """
    wires = {}
    for wire in diagram.wires:
        if isinstance(wire.source, Signal):
            wires.setdefault(wire.block, []).append(wire.source)

    def spoilt(at):
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

    found, waiting, seen = None, spoilt(block), {block}
    while waiting:
        found = waiting.pop(0)
        before = spoilt(found.block)
        if not before:
            break
        if found.block not in seen:
            seen.add(found.block)
            waiting += before
    return found


def signal_values(schedule, values, signal):
    """The elements of a signal among all values of a tick."""
    place = schedule.signals[signal.path]
    return values[place.slot : place.slot + place.size]


def worst(elements):
    """The first element that is not finite."""
    return next(value for value in elements if not math.isfinite(value))


def own_traceback(file, error):
    """The exception of a user's block: its own lines, none of ours."""
    # that one is the watchdog's, not the block's
    said = [] if isinstance(error, KeyboardInterrupt) else last_lines(error)
    return [
        *(f"{frame.filename}:{frame.lineno} in {frame.name}: {frame.line}" for frame in own_frames(file, error)),
        *said,
    ]
