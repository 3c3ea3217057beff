"""One run of `bench views`, in a process of its own: `python -m tests.bench.views_process`.

The arguments are NONE or ALL, the duration in s, `--realtime`, a folder, and the UDP port of a listener. The process
prints a line of JSON: `lateness` and `period` as counts, `ticks`, `missed`, `dropped`, `problems`; or `refused`.
"""

from __future__ import annotations

import json
import socket
import sys
from importlib.util import find_spec
from pathlib import Path

from blocks.mathematics import Gain
from blocks.recorders import CsvRecorder
from blocks.sinks import PlotJuggler, Rerun
from blocks.sources import Sine
from graph import Diagram, compile, subsystem
from runtime.host.machine.realtime import RealtimeRefused
from runtime.record.recorder import RecorderError
from runtime.robot.loading.simulation import Simulation
from runtime.session.prepare import Prepared
from runtime.session.request import Request
from runtime.session.result import Result
from runtime.session.session import Session

RATE, SIGNALS = 1000, 100  # Hz
NONE, ALL = "none", "all"


def diagram(viewed: bool, folder: Path, port: int) -> Diagram:
    """Build SIGNALS signals in four subsystems. port : UDP port that PlotJuggler's packets go to"""
    with Diagram("views", RATE) as made:
        for side in range(4):
            with subsystem(f"part{side}"):
                for index in range(SIGNALS // 8):
                    Gain(2.0, name=f"gain{index}")(Sine(frequency=0.1 + index, name=f"sine{index}")())
        for index in range(SIGNALS % 8 // 2):
            Gain(2.0, name=f"gain{index}")(Sine(name=f"sine{index}")())
        if viewed:
            CsvRecorder()
            PlotJuggler(port=port)
            if find_spec("rerun") is not None:
                Rerun(target=str(Path(folder) / "views.rrd"), name="rerun_file")
                Rerun(target="serve", port=_free_port(), web_port=_free_port(), name="rerun_server")
    return made


def chunk(viewed: bool, seconds: float, realtime: str, folder: Path, port: int) -> Result:
    """Run the diagram. Returns the Result.

    viewed : whether with all recorders and viewers
    seconds : duration
    realtime : as in `--realtime`
    folder : folder of the recording
    port : UDP port to which PlotJuggler's packets are sent
    """
    made = diagram(viewed, folder, port)
    schedule = compile(made)
    request = Request(
        Path(__file__),
        duration=seconds,
        record=Path(folder) if viewed else None,
        no_record=not viewed,
        realtime=realtime,
    )
    return Session(
        Prepared(request, made, schedule, Simulation(None, made, schedule), None, round(seconds * RATE))
    ).carry_out()


def main(name: str, seconds: str, realtime: str, folder: str, port: str) -> None:
    """Carry out the run, and print its report as JSON. Arguments as on the command line."""
    try:
        result = chunk(name == ALL, float(seconds), realtime, Path(folder), int(port))
    except (RealtimeRefused, RecorderError) as error:
        report = {"refused": str(error)}
    else:
        shared = result.shared
        assert shared is not None
        report = {what: shared.counts(what).tolist() for what in ("lateness", "period")}
        report |= {what: result.statistics[what] for what in ("ticks", "missed", "dropped")}
        report["problems"] = result.recording["problems"]
    print(json.dumps(report))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


if __name__ == "__main__":
    main(*sys.argv[1:])
