"""What looking on costs the loop: 100 signals at 1000 Hz, with every recorder and viewer on, and with none; chunks in turn, samples pooled."""

import socket
import tempfile
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler, Rerun
from blocks.sources import Sine
from graph import Diagram, compile, subsystem
from runtime.bench.clock import Kept
from runtime.run import Prepared, Request, run
from runtime.simulation import Simulation

RATE, SIGNALS = 1000, 100       # Hz
NONE, ALL = "none", "all"


def views():
    """What is on, in words; Rerun only where it is installed."""
    return ["CSV", "MCAP", "PlotJuggler", *(["Rerun's file", "Rerun's server"] if find_spec("rerun") is not None else [])]


def diagram(looked_at, folder, port):
    """SIGNALS signals in four subsystems. port : that somebody listens on"""
    with Diagram("views", RATE) as made:
        for side in range(4):
            with subsystem(f"part{side}"):
                for index in range(SIGNALS // 8):
                    Gain(2.0, name=f"gain{index}")(Sine(frequency=0.1 + index, name=f"sine{index}")())
        for index in range(SIGNALS % 8 // 2):
            Gain(2.0, name=f"gain{index}")(Sine(name=f"sine{index}")())
        if looked_at:
            CsvRecorder()
            PlotJuggler(port=port)
            if find_spec("rerun") is not None:
                Rerun(target=str(Path(folder) / "views.rrd"), name="rerun_file")
                Rerun(target="serve", port=free_port(), web_port=free_port(), name="rerun_server")
    return made


def chunk(looked_at, seconds, realtime, folder, port):
    """One run. Returns the Result."""
    made = diagram(looked_at, folder, port)
    schedule = compile(made)
    request = Request(Path(__file__), duration=seconds, record=Path(folder) if looked_at else None, no_record=not looked_at, realtime=realtime)
    return run(Prepared(request, made, schedule, Simulation(None, made, schedule), None, round(seconds * RATE)))


def measure(seconds, repeats, realtime="off"):
    """({NONE, ALL: Kept}, [what the recorders told of trouble], records that were dropped). RecorderError, RealtimeRefused"""
    found, problems, dropped = {NONE: Kept(), ALL: Kept()}, [], 0
    with ExitStack() as stack:
        listener = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        listener.bind(("127.0.0.1", 0))
        for _ in range(repeats):
            for name, kept in found.items():
                with tempfile.TemporaryDirectory() as folder:
                    result = chunk(name == ALL, seconds, realtime, folder, listener.getsockname()[1])
                counts = [result.page.counts(what) for what in ("lateness", "period")]
                kept.add(*counts, result.statistics["ticks"], result.statistics["missed"])
                problems += result.recording["problems"]
                dropped += result.statistics["dropped"]
    return found, problems, dropped


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
