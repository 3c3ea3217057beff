"""One drive, watched live without torque: asked again and again with the frame that takes its torque away.

One that reports by itself, a CubeMars in servo mode, is listened to, and is left as it is.
"""

import math
import sys
import time
from dataclasses import dataclass

from blocks.actuators.cubemars import asking as mit
from blocks.actuators.robstride import asking as private
from runtime.errors import BadInput
from runtime.recorder.csv import CsvWriter
from runtime.recorder.plotjuggler import PlotJugglerSender
from runtime.terminal import tell
from runtime.tools.scan import refuse_company

SIGNALS = {"position": "rad", "velocity": "rad/s", "torque": "N·m", "temperature": "°C"}
ASCII = {"N·m": "N*m", "°C": "degC"}
SILENT = 1.0                    # s without an answer, then it is told
REPORTING = 0.15                # s in which a drive that reports by itself is heard
REFRESH = 0.1                   # s between two lines on a terminal
SLOW = 1.0                      # and where it is none


@dataclass
class Told:
    """answers : how many came; asked : how many questions went out; files : that were written; lost : datagrams"""

    answers: int = 0
    asked: int = 0
    files: tuple = ()
    lost: int = 0


class Watched:
    """A drive, of whichever protocol it speaks. BadInput where nobody answers, or somebody else commands drives here.

    model : of blocks.actuators.cubemars.models or robstride.models, or None: velocity and torque are then not known
    """

    def __init__(self, bus, can_id, model=None):
        self.bus, self.can_id, self.model = bus, can_id, model
        refuse_company(bus)
        self.question, self.read = None, self.report
        if (found := self.ask(REPORTING)) is not None:
            self.family = found.family
            return
        for question, read in (
                (private.stop(can_id), lambda *frame: private.feedback(*frame, can_id, model)),
                (mit.question(can_id), lambda *frame: mit.answer(*frame, can_id, model)),
                (mit.question_of_v3(can_id), self.report)):
            self.question, self.read = question, read
            found = bus.ask(question, "disable", read)
            if found is not None:
                self.family = found.family
                return
        raise BadInput(f"nobody answers as id {can_id} on {bus.bus.channel}; the command `scan` tells who is on the bus")

    def ask(self, patience):
        """The Answer, None if none came in time."""
        if self.question is None:
            heard = self.bus.listen(patience, lambda frames: any(map(self.is_report, frames)))
            return next((self.read(*frame) for frame in reversed(heard) if self.is_report(frame)), None)
        return self.bus.ask(self.question, "disable", self.read, patience=patience, attempts=1)


    def report(self, *frame):
        answer = mit.servo_status(*frame, self.model)
        return answer if answer is not None and answer.can_id == self.can_id else None

    def is_report(self, frame):
        return self.report(*frame) is not None


def columns(name):
    return [
        {"path": f"{name}.{signal}", "unit": unit, "ascii_unit": ASCII.get(unit, unit), "dtype": "float"}
        for signal, unit in SIGNALS.items()]


def stream(drive, name, rate, duration, folder=None, plotjuggler=None, clock=time.monotonic):
    """Watch until the time is over, or Ctrl-C. Returns a Told; raises OSError where a file or a host is not there.

    name : of the drive, in files; rate : Hz; duration : s, None for ever; folder : of a CSV file; plotjuggler : (host, port)
    """
    sinks, told = [], Told()
    plan = {"folder": folder, "stem": f"{name}_{time.strftime('%Y-%m-%d_%H-%M-%S')}"}
    if folder is not None:
        sinks.append(CsvWriter(plan, {"parameters": {}, "columns": columns(name)}))
    if plotjuggler is not None:
        sinks.append(PlotJugglerSender(plan, {"parameters": dict(zip(("host", "port"), plotjuggler)), "columns": columns(name)}))
    for sink in sinks:
        sink.open()
    live = sys.stdout.isatty()
    began = heard = clock()
    shown, tick = -SLOW, 0
    try:
        while duration is None or tick < duration * rate:
            now = clock() - began
            if now < tick / rate:
                time.sleep(tick / rate - now)
            elif now > (tick + 1) / rate:
                tick = int(now * rate)                          # what was missed is not made up for
            told.asked += 1
            answer = drive.ask(min(0.05, 1.0 / rate))
            now = clock() - began
            if answer is not None:
                told.answers, heard = told.answers + 1, clock()
                row = [math.nan if (value := getattr(answer, signal)) is None else value for signal in SIGNALS]
                for sink in sinks:
                    sink.row(tick, tick / rate, row)
                if now - shown >= (REFRESH if live else SLOW):
                    shown = show(now, line(now, answer), live)
            elif clock() - heard > SILENT and now - shown >= SLOW:
                shown = show(now, f"{now:8.1f} s  silent for {clock() - heard:.0f} s", live)
            tick += 1
    except KeyboardInterrupt:
        pass
    finally:
        for sink in sinks:
            said = sink.close()
            told.files += tuple(f"{path}  ({remark})" for path, remark in sink.files.items())
            told.lost += said.get("lost", 0)
    if live:
        tell([""])
    return told


def show(now, text, live):
    if live:
        sys.stdout.write(f"\r{text}\x1b[K")
        sys.stdout.flush()
    else:
        tell([text])
    return now


def line(now, answer):
    def number(value, width, digits, unit):
        return f"{'-':>{width}} {unit}" if value is None else f"{value:{width}.{digits}f} {unit}"

    words = [
        number(answer.position, 8, 3, "rad"), number(answer.velocity, 7, 2, "rad/s"), number(answer.torque, 7, 2, "N·m"),
        number(answer.temperature, 4, 0, "°C"), *([f"fault: {answer.fault}"] if answer.fault else [])]
    return f"{now:8.1f} s  " + "  ".join(words)
