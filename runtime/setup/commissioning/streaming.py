"""Live display of one drive without torque: the tool polls it with the frame that disables its motor.

A drive that reports unasked receives no frames.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.host.console.stderr import STDOUT, Terminal
from runtime.host.console.terminal import print_lines
from runtime.host.ending import Interrupted, forget_interrupt
from runtime.host.errors import BadInput
from runtime.record.recorder.services.csv import CsvWriter
from runtime.record.recorder.services.plotjuggler import PlotJugglerSender
from runtime.record.storage.ascii_units import ascii_name
from runtime.setup.commissioning.scan import merged_stop_queries, refuse_company

if TYPE_CHECKING:
    from graph.family import Answer, Drive
    from runtime.robot.rig.tool_bus import ToolBus

SIGNALS = {"position": "rad", "velocity": "rad/s", "torque": "N·m", "temperature": "°C"}
SILENCE_TIMEOUT = 1.0  # s without an answer until silence is reported
REPORT_TIMEOUT = 0.15  # s until a drive that reports unasked has reported
TERMINAL_INTERVAL = 0.1  # s between two lines on a terminal
LOG_INTERVAL = 1.0  # s between two lines on another output
FLUSH_INTERVAL = 0.5  # s between two flushes of the sinks
ELEMENTS = {"euler": ("roll", "pitch", "yaw"), "raw_euler": ("roll", "pitch", "yaw")}


@dataclass
class StreamResult:
    """Counts and files of a finished stream.

    answers, asked : numbers of answers received and of queries sent
    files : files written, as text
    lost : datagrams that a sink could not send
    """

    answers: int = 0
    asked: int = 0
    files: tuple[str, ...] = ()
    lost: int = 0


class Watched:
    """Drive of any family on a ToolBus.

    drive, model : graph.family.Drive and its model, or None, without which velocity and torque are not available

    Raises BadInput if no drive responds as `can_id`, the drive is of another family than the model, or another
    controller commands drives on the bus.
    """

    def __init__(self, bus: ToolBus, can_id: int, drive: Drive | None = None, model: Any = None) -> None:
        self.bus, self.can_id, self.model = bus, can_id, model
        refuse_company(bus)
        for self.question, self.read in merged_stop_queries(can_id, drive, model):
            if self.question is None:
                answer = self.ask(REPORT_TIMEOUT)
            else:
                answer = bus.ask(self.question, "disable", self.read)
            if answer is not None:
                if model is not None and answer.velocity is None:  # another family's, decoded without the model
                    raise BadInput(
                        f"id {can_id} on {bus.bus.channel} is a {answer.family}, and {model.name} is a model of "
                        "another family: pass the drive's own --model, or none"
                    )
                self.family = answer.family
                return
        raise BadInput(f"no drive responds as id {can_id} on {bus.bus.channel}; `scan` lists the drives on the bus")

    def ask(self, timeout: float) -> Answer | None:
        """Return the Answer, or None if none arrives within `timeout` s."""
        if self.question is None:
            frames = self.bus.listen(timeout, lambda frames: any(self.read(*frame) is not None for frame in frames))
            answers = (self.read(*frame) for frame in reversed(frames))
            return next((answer for answer in answers if answer is not None), None)
        return self.bus.ask(self.question, "disable", self.read, timeout=timeout, attempts=1)

    def columns(self, name: str) -> list[dict[str, str]]:
        """Return the columns of `row`. name : name of the drive"""
        return [column(f"{name}.{signal}", unit) for signal, unit in SIGNALS.items()]

    def row(self, answer: Answer) -> list[float]:
        """Return the values of the columns, NaN where the drive does not report one."""
        return [math.nan if (value := getattr(answer, signal)) is None else value for signal in SIGNALS]

    def line(self, answer: Answer) -> str:
        """Return an answer as a line for the terminal."""
        return _line(answer)


def column(path: str, unit: str) -> dict[str, str]:
    """Return the description of a column as the sinks of the recorder use it."""
    return {"path": path, "unit": unit, "ascii_unit": ascii_name(unit), "dtype": "float"}


def in_subsystems(columns: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the columns with one subsystem per channel of a device.

    Rerun then draws each channel in a separate plot and recognises attitudes.
    """
    renamed = []
    for each in columns:
        match = re.fullmatch(r"(.+)\.(\w+)(?:\[(\d+)\])?", each["path"])
        assert match is not None
        device, port, element = match.groups()
        names = ELEMENTS.get(port, "xyz")
        if port == "quaternion":
            path = f"{device}/{port}/attitude.quaternion[{element}]"
        elif element is None:
            path = f"{device}/{port}/{port}.value"
        else:
            path = f"{device}/{port}/{port}.{names[int(element)] if int(element) < len(names) else element}"
        renamed.append({**each, "path": path})
    return renamed


def sinks_of(
    drive: Any,
    name: str,
    rate: float,
    folder: str | Path | None,
    plotjuggler: tuple[str, int] | None,
    rerun: str | None,
) -> list[Any]:
    """Return the sinks for the rows, not yet open. Arguments as for `stream`."""
    plan: Any = {  # the keys that these services read
        "name": name,
        "folder": folder,
        "stem": f"{name}_{time.strftime('%Y-%m-%d_%H-%M-%S')}",
        "rate": rate,
        "virtual": False,
    }
    sinks, columns = [], [{**column, "index": index} for index, column in enumerate(drive.columns(name))]

    def sink(path: str, columns: list[Any], **parameters: Any) -> Any:
        return {"path": path, "parameters": parameters, "columns": columns}

    if folder is not None:
        sinks.append(CsvWriter(plan, sink("csv", columns)))
    if plotjuggler is not None:
        host, port = plotjuggler
        sinks.append(PlotJugglerSender(plan, sink("plotjuggler", columns, host=host, port=port)))
    if rerun is not None:
        from runtime.record.recorder.rerun.target import PORT, WEB_PORT
        from runtime.record.recorder.services.rerun import RerunSender

        columns = in_subsystems(columns)
        sinks.append(RerunSender(plan, sink("rerun", columns, target=rerun, port=PORT, web_port=WEB_PORT)))
        sinks[-1].say = lambda line: print_lines([line])
    return sinks


def stream(
    drive: Any,
    name: str,
    rate: float,
    duration: float | None,
    folder: str | Path | None = None,
    plotjuggler: tuple[str, int] | None = None,
    rerun: str | None = None,
    clock: Callable[[], float] = time.monotonic,
) -> StreamResult:
    """Show a drive or sensor until the duration is over or Ctrl-C. Returns a StreamResult.

    drive : Watched, or another object with the methods ask, columns, row and line
    name : name of the drive in files
    rate : Hz
    duration : s, None for no limit
    folder : folder of a CSV file, or None
    plotjuggler : (host, port), or None
    rerun : target as in runtime.record.recorder.rerun.target, or None

    Raises OSError if a file or host is not available.
    """
    sinks, result = sinks_of(drive, name, rate, folder, plotjuggler, rerun), StreamResult()
    for sink in sinks:
        sink.open()
    screen = Terminal(STDOUT)
    began = answered = clock()
    shown, tick, flushed = -LOG_INTERVAL, 0, -FLUSH_INTERVAL
    try:
        while duration is None or tick < duration * rate:
            now = clock() - began
            if now < tick / rate:
                time.sleep(tick / rate - now)
            elif now > (tick + 1) / rate:
                tick = int(now * rate)  # missed ticks are skipped
            result.asked += 1
            answer = drive.ask(min(0.05, 1.0 / rate))
            now = clock() - began
            if answer is not None:
                result.answers, answered = result.answers + 1, clock()
                row = drive.row(answer)
                flushes = now - flushed >= FLUSH_INTERVAL
                flushed = now if flushes else flushed
                for sink in list(sinks):
                    give(sink, tick, tick / rate, row, flushes, sinks)
                if now - shown >= (TERMINAL_INTERVAL if screen.interactive else LOG_INTERVAL):
                    shown = show(now, f"{now:8.1f} s  {drive.line(answer)}", screen)
            elif clock() - answered > SILENCE_TIMEOUT and now - shown >= LOG_INTERVAL:
                shown = show(now, f"{now:8.1f} s  no reply for {clock() - answered:.0f} s", screen)
            tick += 1
    except Interrupted:
        forget_interrupt()
    finally:
        for sink in sinks:
            closing = sink.close()
            result.files += tuple(f"{path}  ({remark})" for path, remark in sink.files.items())
            result.lost += closing.get("lost", 0)
            if "problem" in closing:
                print_lines([closing["problem"]])
    if screen.interactive:
        print_lines([""])
    return result


def give(sink: Any, tick: int, now: float, row: Sequence[float], flushes: bool, sinks: list[Any]) -> None:
    """Write a row to a sink.

    A viewer that has closed is reported and removed from `sinks`. Raises OSError if a file cannot be written.

    flushes : whether to flush this row and all rows before it
    """
    try:
        sink.row(tick, now, row)
        if flushes:
            sink.flush()
    except OSError as error:
        if not sink.elsewhere:
            raise
        print_lines(["", f"{sink.sink['path']}: {error.strerror or error}; streaming continues without it"])
        sink.close()
        sinks.remove(sink)


def show(now: float, text: str, screen: Terminal) -> float:
    """Show a line: in place on a terminal, else as a line of its own. Returns `now`."""
    if screen.interactive:
        screen.draw(text[: max(0, screen.columns - 1)])  # a wrapped line would scroll the terminal
    else:
        print_lines([text])
    return now


def _line(answer: Answer) -> str:
    def number(value, width, digits, unit):
        return f"{'-':>{width}} {unit}" if value is None else f"{value:{width}.{digits}f} {unit}"

    parts = [
        number(answer.position, 8, 3, "rad"),
        number(answer.velocity, 7, 2, "rad/s"),
        number(answer.torque, 7, 2, "N·m"),
        number(answer.temperature, 4, 0, "°C"),
        *([f"fault: {answer.fault}"] if answer.fault else []),
    ]
    return "  ".join(parts)
