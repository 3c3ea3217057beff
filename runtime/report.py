"""The end of a run, in words and numbers."""

import signal
import traceback

from runtime.errors import FAULT, OK


def exit_code(outcome):
    """0, 3 after a fault, or 128 + the number of the signal that ended the run."""
    if outcome.faulted:
        return FAULT
    return 128 + outcome.signal if outcome.signal else OK


def summary(result):
    """Lines for standard output."""
    statistics, outcome, schedule = result.statistics, result.outcome, result.schedule
    ticks, missed = statistics["ticks"], statistics["missed"]
    passed = ticks + missed
    seconds = passed / schedule.rate
    how = "simulated"
    if result.simulation.program is None:
        how = "no devices"
    elif not result.simulation.given:
        how = "simulated, with every device emulated and each actuator on a free inertia (the file has no plant)"
    if result.request.fast:
        how += ", in virtual time"
    rows = [f"{schedule.name}: {seconds:g} s at {schedule.rate:g} Hz, {how}"]

    def row(label, text):
        rows.append(f"  {label:<12}{text}")

    of = f" of {result.asked}" if result.asked >= 0 else ""
    row("ticks", f"{ticks}{of} done, {missed} missed; {statistics['dropped']} records dropped")
    late = statistics["lateness"]
    if result.request.fast:
        spent = statistics["busy"]
        row("speed", f"{seconds / spent:.0f} times real time ({spent:.3f} s in ticks, {statistics['waited_for_recorder']:.3f} s waiting for the recorder)"
            if spent else "no tick was done")
    elif late["count"]:
        row("rate", f"{schedule.rate * ticks / passed:.2f} Hz held")
        row("late by", f"{micro(late['p50'])} median, {micro(late['p99'])} p99, {micro(late['p99.9'])} p99.9, {micro(late['max'])} at most (tick {late['max_at_tick']})")
        row("load", f"{100 * statistics['busy'] / seconds:.2f} % of the time inside ticks, {micro(statistics['execution']['p99'])} a tick at p99")
    frames = statistics["frames"]
    if schedule.buses:
        spoilt = frames["foreign"] + frames["malformed"]
        row("buses", f"{', '.join(schedule.buses)}: {frames['sent']} frames sent, {frames['received']} received, {spoilt} of them foreign or malformed")
    for stride in result.recording.get("strides", []):
        row(stride["title"], stride_text(stride))
    if schedule.devices:
        row("safe stop", stop_text(outcome, schedule))
    for index, file in enumerate(result.recording.get("files", [])):
        note = f"  ({file['note']})" if file.get("note") else ""
        row("files" if index == 0 else "", f"{file['path']}{note}")
    for problem in result.recording.get("problems", []):
        row("recorder", problem)
    return rows


def stride_text(stride):
    if not stride["strides"]:
        return f"no whole stride; peak torque {stride['peak_torque']:.1f} N·m"
    return (
        f"{stride['strides']} strides of {stride['stride_time']:.2f} s; peak torque {stride['peak_torque']:.1f} N·m; work a stride "
        f"{stride['positive_work']:+.2f} J and {stride['negative_work']:+.2f} J")


def stop_text(outcome, schedule):
    if outcome.unconfirmed:
        return f"sent, but NOT confirmed by {', '.join(outcome.unconfirmed)}"
    return f"zero torque, then disable: confirmed by {', '.join(device.name for device in schedule.devices)}"


def micro(seconds):
    if seconds < 1e-3:
        return f"{seconds * 1e6:.0f} µs"
    return f"{seconds * 1e3:.1f} ms"


def fault(result):
    """Lines for standard error after a fault."""
    outcome, schedule = result.outcome, result.schedule
    when = f"tick {outcome.tick} ({outcome.tick / schedule.rate:.3f} s)" if outcome.tick >= 0 else "while arming"
    what = {
        "not finite": "a command is NaN or infinite",
        "out of limits": "a command has left the interval that was proved",
        "exception": "its step raised an exception",
        "no answer": f"{', '.join(outcome.unanswered)} did not answer while arming",
        "silent": "no reply for longer than its timeout",
        "device fault": "the device reports a fault",
        "bus error": "the bus can neither send nor receive",
    }.get(outcome.status, outcome.status)
    rows = [f"FAULT at {outcome.culprit or schedule.name}, {when}: {what}"]
    if result.inputs:
        rows.append("  its inputs: " + ", ".join(f"{name} = {value:g}" for name, value in result.inputs.items()))
    if outcome.error is not None:
        rows += block_traceback(outcome.error)
    rows.append("  every actuator was sent zero torque, then disable; nothing re-enables it by itself")
    return rows


def block_traceback(error):
    """The exception of a user's block: its own lines, none of ours."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f"  {frame.filename}:{frame.lineno} in {frame.name}: {frame.line}" for frame in frames if not frame.filename.endswith((".pyx", ".pxd"))]
    return [*lines, f"  {type(error).__name__}: {error}"]


def hints(result):
    """Three things to try next."""
    file = result.request.file
    tries = []
    pictures = [f["path"] for f in result.recording.get("files", []) if f["path"].endswith(".png")]
    tables = [f["path"] for f in result.recording.get("files", []) if f["path"].endswith(".csv")]
    if pictures:
        tries.append(f"look at the average stride: {pictures[0]}")
    elif tables:
        tries.append(f"open the recording in a spreadsheet or with pandas: {tables[0]}")
    for block in result.diagram:
        live = [(name, param) for name, param in block.parameters.items() if param.live]
        if live:
            name, param = live[0]
            value = getattr(block, name)
            other = param.min + (param.max - param.min) / 2 if value in (param.min, param.max) else value / 2
            tries.append(f"change a parameter: python -m runtime {file} --duration 10 --set {block.path}.{name}={other:g}")
            break
    if not result.request.fast:
        tries.append(f"run a minute as fast as the machine can: python -m runtime {file} --fast --duration 60")
    if any(sink.block.service.endswith("PlotJugglerSender") for sink in result.schedule.sinks):
        tries.append("watch it live: PlotJuggler, Streaming, UDP Server, port 9870, JSON, timestamp field `timestamp`")
    tries.append("measure this machine: python -m runtime bench")
    return ["try next", *(f"  {line}" for line in tries[:3])]


def signal_name(number):
    return signal.Signals(number).name


