"""What looking on costs the loop: 100 signals at 1000 Hz, with every recorder and viewer on, and with none.

Chunks take turns, each in a process of its own, and their samples are pooled.
"""

import json
import os
import socket
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler, Rerun
from blocks.sources import Sine
from graph import Diagram, compile, subsystem
from runtime.base.errors import BadInput
from runtime.bench.clock import Kept
from runtime.console.progress import rounds
from runtime.diagrams.simulation import Simulation
from runtime.session.run import Prepared, Request, run

RATE, SIGNALS = 1000, 100  # Hz
NONE, ALL = "none", "all"


def views():
    """What is on, in words; Rerun only where it is installed."""
    return [
        "CSV",
        "MCAP",
        "PlotJuggler",
        *(["Rerun's file", "Rerun's server"] if find_spec("rerun") is not None else []),
    ]


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
    request = Request(
        Path(__file__),
        duration=seconds,
        record=Path(folder) if looked_at else None,
        no_record=not looked_at,
        realtime=realtime,
    )
    return run(Prepared(request, made, schedule, Simulation(None, made, schedule), None, round(seconds * RATE)))


def elsewhere(name, seconds, realtime, folder, port):
    """What runtime.bench.views_process tells of a chunk. BadInput"""
    words = [sys.executable, "-m", "runtime.bench.views_process", name, str(seconds), realtime, str(folder), str(port)]
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        words, stdin=subprocess.DEVNULL, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": path}
    )
    if done.returncode:
        raise BadInput(
            f"a chunk with {name} ended with code {done.returncode}: {(done.stderr.splitlines() or ['no word'])[-1]}"
        )
    told = json.loads(done.stdout)
    if "refused" in told:
        raise BadInput(told["refused"])
    return told


def measure(seconds, repeats, realtime="off"):
    """({NONE, ALL: Kept}, [what the recorders told of trouble], records that were dropped). BadInput"""
    found, problems, dropped = {NONE: Kept(), ALL: Kept()}, [], 0
    with ExitStack() as stack:
        listener = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        listener.bind(("127.0.0.1", 0))
        for _ in rounds("measuring", repeats):
            for name, kept in found.items():
                with tempfile.TemporaryDirectory() as folder:
                    told = elsewhere(name, seconds, realtime, folder, listener.getsockname()[1])
                kept.add(
                    *(np.array(told[what], dtype=np.uint64) for what in ("lateness", "period")),
                    told["ticks"],
                    told["missed"],
                )
                problems += told["problems"]
                dropped += told["dropped"]
    return found, problems, dropped


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]
