"""One drive, shown live without torque: asked again and again with the frame that takes its torque away.

A drive that reports without being asked is only listened to.
"""

import math
import re
import time
from dataclasses import dataclass

from runtime.base.ending import Interrupted, handled
from runtime.base.errors import BadInput
from runtime.commissioning.scan import merged_stop_queries, refuse_company
from runtime.console.stderr import STDOUT, Terminal
from runtime.console.terminal import tell
from runtime.recorder.csv import CsvWriter
from runtime.recorder.plotjuggler import PlotJugglerSender
from runtime.recording.ascii_units import ascii_name

SIGNALS = {"position": "rad", "velocity": "rad/s", "torque": "N·m", "temperature": "°C"}
SILENT = 1.0  # s without an answer, then it is reported
REPORTING = 0.15  # s in which a drive reports that does so unasked
REFRESH = 0.1  # s between two lines on a terminal
SLOW = 1.0  # and where it is none
FLUSH = 0.5  # s between two flushes of what takes the rows
ELEMENTS = {"euler": ("roll", "pitch", "yaw"), "raw_euler": ("roll", "pitch", "yaw")}


@dataclass
class Told:
    """answers : how many came; asked : how many questions went out; files : that were written; lost : datagrams"""

    answers: int = 0
    asked: int = 0
    files: tuple = ()
    lost: int = 0


class Watched:
    """A drive of any family. BadInput where none answers, or another controller commands drives on its bus.

    model : of its family, or None: velocity and torque are then not known
    """

    def __init__(self, bus, can_id, model=None):
        self.bus, self.can_id, self.model = bus, can_id, model
        refuse_company(bus)
        for self.question, self.read in merged_stop_queries(can_id, model):
            if self.question is None:
                found = self.ask(REPORTING)
            else:
                found = bus.ask(self.question, "disable", self.read)
            if found is not None:
                self.family = found.family
                return
        raise BadInput(f"no drive answers as id {can_id} on {bus.bus.channel}; `scan` lists the drives on the bus")

    def ask(self, patience):
        """The Answer, None if none came in time."""
        if self.question is None:
            heard = self.bus.listen(patience, lambda frames: any(self.read(*frame) is not None for frame in frames))
            answers = (self.read(*frame) for frame in reversed(heard))
            return next((answer for answer in answers if answer is not None), None)
        return self.bus.ask(self.question, "disable", self.read, patience=patience, attempts=1)

    def columns(self, name):
        return [column(f"{name}.{signal}", unit) for signal, unit in SIGNALS.items()]

    def row(self, answer):
        """Numbers for the columns."""
        return [math.nan if (value := getattr(answer, signal)) is None else value for signal in SIGNALS]

    def line(self, answer):
        """Return the line for the terminal."""
        return line(answer)


def column(path, unit):
    return {"path": path, "unit": unit, "ascii_unit": ascii_name(unit), "dtype": "float"}


def in_subsystems(columns):
    """The same columns with a subsystem a channel of a device, so that Rerun draws each in a plot of its own, and finds
    attitudes.
    """
    found = []
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
        found.append({**each, "path": path})
    return found


def sinks_of(drive, name, rate, folder, plotjuggler, rerun):
    """What takes the rows, not yet open."""
    plan = {
        "name": name,
        "folder": folder,
        "stem": f"{name}_{time.strftime('%Y-%m-%d_%H-%M-%S')}",
        "rate": rate,
        "virtual": False,
    }
    sinks, columns = [], drive.columns(name)
    if folder is not None:
        sinks.append(CsvWriter(plan, {"parameters": {}, "columns": columns}))
    if plotjuggler is not None:
        sinks.append(
            PlotJugglerSender(plan, {"parameters": dict(zip(("host", "port"), plotjuggler)), "columns": columns})
        )
    if rerun is not None:
        from runtime.recorder.rerun.sender import RerunSender
        from runtime.recorder.rerun.target import PORT, WEB_PORT

        sinks.append(
            RerunSender(
                plan,
                {
                    "path": "rerun",
                    "parameters": {"target": rerun, "port": PORT, "web_port": WEB_PORT},
                    "columns": in_subsystems(columns),
                },
            )
        )
        sinks[-1].say = lambda line: tell([line])
    return sinks


def stream(drive, name, rate, duration, folder=None, plotjuggler=None, rerun=None, clock=time.monotonic):
    """Watch until the time is over, or Ctrl-C. Returns a Told; raises OSError where a file or a host is not there.

    drive : Watched, or something else that is asked, has columns, and makes a row and a line of what it answers
    name : of the drive, in files; rate : Hz; duration : s, None for ever; folder : of a CSV file; plotjuggler : (host,
        port)
    rerun : as runtime.recorder.rerun.target reads it, None for nowhere
    """
    sinks, told = sinks_of(drive, name, rate, folder, plotjuggler, rerun), Told()
    for sink in sinks:
        sink.open()
    screen = Terminal(STDOUT)
    began = heard = clock()
    shown, tick, flushed = -SLOW, 0, -FLUSH
    try:
        while duration is None or tick < duration * rate:
            now = clock() - began
            if now < tick / rate:
                time.sleep(tick / rate - now)
            elif now > (tick + 1) / rate:
                tick = int(now * rate)  # what was missed is not made up for
            told.asked += 1
            answer = drive.ask(min(0.05, 1.0 / rate))
            now = clock() - began
            if answer is not None:
                told.answers, heard = told.answers + 1, clock()
                row = drive.row(answer)
                flushes = now - flushed >= FLUSH
                flushed = now if flushes else flushed
                for sink in list(sinks):
                    give(sink, tick, tick / rate, row, flushes, sinks)
                if now - shown >= (REFRESH if screen.interactive else SLOW):
                    shown = show(now, f"{now:8.1f} s  {drive.line(answer)}", screen)
            elif clock() - heard > SILENT and now - shown >= SLOW:
                shown = show(now, f"{now:8.1f} s  silent for {clock() - heard:.0f} s", screen)
            tick += 1
    except Interrupted:
        handled()
    finally:
        for sink in sinks:
            said = sink.close()
            told.files += tuple(f"{path}  ({remark})" for path, remark in sink.files.items())
            told.lost += said.get("lost", 0)
            if "problem" in said:
                tell([said["problem"]])
    if screen.interactive:
        tell([""])
    return told


def give(sink, tick, now, row, flushes, sinks):
    """Write a row. flushes : with all rows before it. A viewer that has closed is reported and removed from `sinks`; an
    error of a file is raised.
    """
    try:
        sink.row(tick, now, row)
        if flushes:
            sink.flush()
    except OSError as error:
        if not sink.elsewhere:
            raise
        tell(["", f"{sink.sink['path']}: {error.strerror or error}; the rest goes on"])
        sink.close()
        sinks.remove(sink)


def show(now, text, screen):
    if screen.interactive:
        screen.draw(text[: max(0, screen.columns - 1)])  # one that wrapped would scroll
    else:
        tell([text])
    return now


def line(answer):
    def number(value, width, digits, unit):
        return f"{'-':>{width}} {unit}" if value is None else f"{value:{width}.{digits}f} {unit}"

    words = [
        number(answer.position, 8, 3, "rad"),
        number(answer.velocity, 7, 2, "rad/s"),
        number(answer.torque, 7, 2, "N·m"),
        number(answer.temperature, 4, 0, "°C"),
        *([f"fault: {answer.fault}"] if answer.fault else []),
    ]
    return "  ".join(words)
