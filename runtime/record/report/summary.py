"""Summary of a run: its last lines on the terminal, exit code and hints."""

from __future__ import annotations

import shlex
import signal
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from blocks.sinks import PlotJuggler
from graph import Device
from runtime.host.console.styles import console_for, count
from runtime.host.errors import FAULT, NOT_RECORDED, OK
from runtime.record.analysis.average_stride import left_out_text, signals_texts
from runtime.record.report.failure_coverage import drives_left_commanded, nothing_stops
from runtime.record.report.held_exceptions import text as held_text
from runtime.record.report.timing import spread, timing
from runtime.record.storage.changes import stopped_by
from runtime.record.storage.files import DELETED, INCOMPLETE, STOPPED_EARLY

if TYPE_CHECKING:
    from cext.schedule.outcome import Outcome
    from graph.diagram import Diagram
    from graph.schedule import Schedule
    from runtime.record.report.run_result import RunResult

REJECTED = {  # kinds of frames other than valid replies
    "foreign": "foreign",
    "malformed": "malformed",
    "corrupt": "corrupt",
    "echoes": "echoed",
    "errors": "error frames",
    "overflows": "overflow reports",
    "refused": "not sent because of a full queue",
}


def exit_code(outcome: Outcome, unsaved: str = "") -> int:
    """Return 0, 3 after a fault, 128 + the number of the signal that ended the run, or 4 for a short recording.

    unsaved : what the recording lacks, as text
    """
    if outcome.faulted:
        return FAULT
    return 128 + outcome.signal if outcome.signal else NOT_RECORDED if unsaved else OK


def unsaved_in_words(result: RunResult) -> str:
    """Return what the recording of a run lacks, as text; "" for a complete one."""
    recording = result.recording
    if result.request.no_record:
        return ""
    partial = [file["path"] for file in recording.get("files", []) if file.get("note") in (INCOMPLETE, DELETED)]
    dropped = result.statistics["dropped"]
    lacks = [f"{count(dropped, 'record')} lost"] * bool(dropped and recording.get("files"))
    lacks += [f"incomplete: {', '.join(partial)}"] * bool(partial)
    lacks += recording["problems"][-1:] if recording.get("ended") == STOPPED_EARLY else []
    return "; ".join(lacks)


def stop_reason(outcome: Outcome) -> str | None:
    """Return which signal or key stopped the run, or None."""
    if outcome.stopped:
        return stopped_by(outcome.stopped)
    if not outcome.signal:
        return None
    name = signal.Signals(outcome.signal).name
    return f"stopped by {name}" + (" (Ctrl-C)" if name == "SIGINT" else "")


def summary(result: RunResult) -> list[str]:
    """Return the lines for standard output."""
    schedule, statistics = result.schedule, result.statistics
    passed = statistics["ticks"] + statistics["missed"]
    how = (
        "no devices"
        if not schedule.devices
        else "simulated"
        if result.rig is None
        else "on the bus"  # whose rig file is temporary
        if result.request.bench
        else f"on the rig {result.request.rig}"
    )
    how += ", in virtual time" if result.request.fast else ""
    lacking = unsaved_in_words(result)
    rows = [f"THE RECORDING IS NOT COMPLETE: {lacking}"] * bool(lacking)
    rows += [f"{schedule.name}: {passed / schedule.rate:g} s at {schedule.rate:g} Hz, {how}"]

    def row(label, text):
        rows.append(f"  {label:<11} {text}")

    if result.implausible:
        row("NOT VALID", f"{result.implausible}, beyond the limits of a wearer")
    if schedule.devices and result.rig is None and not result.simulation.given:
        row("plant", "none in the file: every device is emulated, and each actuator drives a free inertia")
    row("ticks", _ticks_text(statistics, result.ticks))
    for label, text in timing(result, passed):
        row(label, text)
    if result.realtime.mode != "off":
        row("realtime", result.realtime.summary())
    if schedule.buses:
        row("buses", _buses_text(schedule.buses, statistics["frames"]))
    events = [event["event"] for event in result.recording.get("events", [])]
    if "set" in events or "mark" in events:
        row(
            "changes",
            f"{count(events.count('set'), 'change')} of live parameters, {count(events.count('mark'), 'mark')}",
        )
    for index, (path, histogram) in enumerate(result.control.reports.latencies.items()):
        if histogram["count"]:
            row("" if index else "replies", f"{path} after {spread(histogram)}")
    for index, words in enumerate(result.rig.sensors() if result.rig is not None else ()):
        row("" if index else "sensors", words)
    for index, words in enumerate(filter(None, (block.run_summary() for block in result.diagram))):
        row("" if index else "blocks", words)
    for entry in result.control.reports.watched:
        if words := watch_text(entry, schedule.rate):
            row("watch", words)
    for index, (path, (zeros, refused)) in enumerate(result.control.reports.zeros.items()):
        row("" if index else "zero", f"{path}: set {count(zeros, 'time')}, refused {count(refused, 'time')}")
    for index, (path, (taken_out, returned)) in enumerate(result.control.reports.switched.items()):
        times = f"taken out {count(taken_out, 'time')}, armed again {count(returned, 'time')}"
        row("" if index else "drive", f"{path}: {times}")
    for entry in result.held:
        row("held", held_text(entry, schedule.rate))
    for index, (path, number, steps) in enumerate(result.control.nan):
        row("" if index else "NaN", f"{path} was NaN in {number} of {count(steps, 'step')}")
    for stride in result.recording.get("strides", []):
        row(stride["title"], stride_text(stride))
        for line in stride_details(stride):
            row("", line)
    if result.outcome.faults:
        row(
            "faults",
            "; ".join(
                f"{fault.status} at {fault.culprit or schedule.name}, tick {fault.tick}"
                for fault in result.outcome.faults
            )
            + ", survived",
        )
    if schedule.devices:
        row("safe stop", _stop_text(result.outcome, schedule))
    for index, caveat in enumerate(schedule.caveats):
        row("" if index else "limits", f"{caveat.path}: {caveat.words}")
    if result.rig is not None and (left := left_over(result.diagram)):
        row("caution", left)
    for index, file in enumerate(result.recording.get("files", [])):
        row("" if index else "files", f"{file['path']}{' ' * 2 * bool(file.get('note'))}{_note(file)}")
    for problem in result.recording.get("problems", []):
        row("recorder", problem)
    if not result.recording.get("files"):
        why = "--no-record" if result.request.no_record else "the diagram has no recorder"
        row("files", f"nothing was recorded: {why}")
    console = console_for()
    return [line for row in rows for line in console.fold(row)]


def _ticks_text(statistics: dict[str, Any], asked: int) -> str:
    of = f" of {asked}" if asked >= 0 else ""
    return f"{statistics['ticks']}{of} done, {statistics['missed']} missed; {statistics['dropped']} records dropped"


def _buses_text(buses: Sequence[str], frames: dict[str, int]) -> str:
    rejected = ", ".join(f"{frames[kind]} {words}" for kind, words in REJECTED.items() if frames.get(kind))
    return f"{', '.join(buses)}: {frames['sent']} frames sent, {frames['received']} received" + (
        f" ({rejected})" if rejected else ""
    )


def watch_text(entry: Mapping[str, Any], rate: float) -> str:
    """Return what the drive monitor reported about one actuator, and for how long; "" for nothing.

    entry : entry of DeviceReports.watched; rate : tick rate, Hz
    """
    reports = [
        f"{words} for {entry[key] / rate:.3g} s"
        for key, words in (
            ("rms_ticks", f"RMS torque too high, up to {entry['rms']:.1f} N·m,"),
            ("warm_ticks", f"warm, up to {entry['temperature']:.0f} °C,"),
            ("derated_ticks", "torque limit reduced by temperature"),
            ("acceleration_ticks", "stiffness and damping removed because of acceleration"),
            ("transit_ticks", "stiffness and damping removed because of late replies"),
            ("end_ticks", "angle unknown, at an end of the range of its frames,"),
        )
        if entry[key]
    ]
    return f"{entry['device']}: {'; '.join(reports)}" if reports else ""


def stride_text(stride: dict[str, Any]) -> str:
    """Return the figures of the average stride of one joint. stride : stride of the recorder's report"""
    peak = f"peak torque {stride['peak_torque']:.1f} N·m"
    left_out = f" ({stride['left_out']} excluded)" if stride["left_out"] else ""
    if not stride["strides"]:
        return f"no complete stride{left_out}; {peak}"
    work = [f"{round(stride[key], 2) + 0.0:.2f} J" for key in ("positive_work", "negative_work")]  # not -0.00
    return (
        f"{stride['strides']} stride{'s' * (stride['strides'] > 1)} of {stride['stride_time']:.2f} s{left_out}; "
        f"{peak}; "
        f"positive work {work[0]} per stride, negative {work[1]}"
    )


def stride_details(stride: dict[str, Any]) -> Iterator[str]:
    """Yield the signals that the figures of a stride are computed from, and what no stride contains."""
    if stride["left_out"]:
        yield f"excluded: {left_out_text(stride)}"
    unused = (("standing", "without walking"), ("unfinished", "of walking outside complete strides"))
    durations = [f"{stride['unused'][key]:.1f} s {words}" for key, words in unused if stride["unused"][key] >= 0.05]
    yield "; ".join([", ".join(signals_texts(stride)), *([f"not used: {', '.join(durations)}"] if durations else [])])


def _stop_text(outcome: Outcome, schedule: Schedule) -> str:
    stopped = [device.name for device in schedule.devices if device.zero or device.disable]
    if not stopped:
        return "zero torque, then disable: not needed, as no device moves"
    late = dict(outcome.late)
    at_once = [name for name in stopped if name not in outcome.unconfirmed and name not in late]
    parts = [f"NOT confirmed by {', '.join(outcome.unconfirmed)}: cut the power"] * bool(outcome.unconfirmed)
    parts += [f"confirmed by {', '.join(at_once)}"] * bool(at_once and not outcome.unconfirmed)
    parts += [f"confirmed by {name} only after {seconds:.2f} s" for name, seconds in late.items()]
    return f"zero torque, then disable: {'; '.join(parts)}"


def left_over(diagram: Diagram) -> str:
    """Return which drives only the control process and the guardian can stop, as text; "" for none."""
    devices = [block for block in diagram if isinstance(block, Device)]
    alone = drives_left_commanded(devices, devices)
    return f"{nothing_stops(alone)} (control process and guardian): see docs/reference/safe_stop.md" if alone else ""


def _note(file: dict[str, str]) -> str:
    return f"({file['note']})" if file.get("note") else ""


def hints(result: RunResult, program: str) -> list[str]:
    """Return three commands to try next. program : command that starts this program"""
    name = shlex.quote(str(result.request.file))
    name = f"./{name}" if name.startswith("-") else name  # else it would be an option
    on_rig = "" if result.rig is None else f" --rig {shlex.quote(str(result.request.rig))}"
    start = f"{program} {name}{on_rig}"
    paths = [] if unsaved_in_words(result) else [file["path"] for file in result.recording.get("files", [])]
    strides = result.recording.get("strides", [])
    picture = next((path for path in paths if path.endswith(".png")), None)
    log = next((path for path in paths if path.endswith(".mcap")), None)
    tries = []
    if strides and not any(stride["strides"] for stride in strides):
        tries.append(f"record complete strides: {start} --duration 20")
    if picture:
        tries.append(f"view the average stride: {picture}")
    elif log and any(stride["strides"] for stride in strides):
        tries.append(f"plot the average stride: {program} plot {shlex.quote(log)} --strides")
    elif log:
        tries.append(f"plot the recording: {program} plot {shlex.quote(log)}")
    change = other_value(result.diagram)
    if change:
        tries.append(f"change a parameter: {start} --duration 10 --set {change}")
    if not result.request.fast and result.rig is None:
        tries.append(f"simulate a minute in virtual time: {start} --duration 60 --fast")
    viewers = [sink.block for sink in result.schedule.sinks if isinstance(sink.block, PlotJuggler)]
    ports = dict.fromkeys(str(viewer.port) for viewer in viewers if viewer.is_active(result.request.fast))
    if ports:
        tries.append(
            f"watch live in PlotJuggler: Streaming, UDP Server, port {' or '.join(ports)}, JSON, field `timestamp` as "
            "time"
        )
    tries.append(f"show what is proved: {program} check {name}{on_rig}")
    tries.append(f"measure this machine: {program} bench")
    return ["try next", *(f"  {line}" for line in tries[:3])]


def other_value(diagram: Diagram) -> str | None:
    """Return a live parameter with another valid value, as 'left/profile.scale=0.5'; None without one."""
    for block in diagram:
        for name in block.parameters:
            bounds = block.live(name)
            if bounds and block.parameters[name].dtype is float:
                value = getattr(block, name)
                half = value / 2 if bounds.min <= value / 2 <= bounds.max and value else (bounds.min + bounds.max) / 2
                return f"{block.path}.{name}={half:g}"
    return None
