"""Lateness of a loop of 100 signals at 1000 Hz with every recorder and viewer on, beside the same with none.

Chunks take turns, each in a process of its own, and their samples are pooled.
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from runtime.host.console.progress import rounds
from runtime.host.errors import BadInput
from runtime.host.system import end_with_parent
from runtime.setup.bench.clock import Kept, Samples
from tests.bench import views_process
from tests.bench.views_process import ALL, NONE


def viewers() -> list[str]:
    """Return the names of the recorders and viewers of ALL. Rerun is included only where it is installed."""
    rerun = ["Rerun's file", "Rerun's server"] if find_spec("rerun") is not None else []
    return ["CSV", "MCAP", "PlotJuggler", *rerun]


def chunk(name: str, seconds: float, realtime: str, folder: str, port: int) -> dict[str, Any]:
    """Run one chunk in a process of its own. Returns what views_process prints. Raises BadInput."""
    words = [sys.executable, "-m", views_process.__name__, name, str(seconds), realtime, str(folder), str(port)]
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        words,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": path},
        preexec_fn=end_with_parent,
    )
    if done.returncode:
        last = (done.stderr.splitlines() or ["without a message"])[-1]
        raise BadInput(f"a chunk with {name} ended with exit code {done.returncode}: {last}")
    report = json.loads(done.stdout)
    if "refused" in report:
        raise BadInput(report["refused"])
    return report


def measure(seconds: float, repeats: int, realtime: str = "off") -> tuple[dict[str, Kept], list[Any], int]:
    """Measure both in turn. Raises BadInput.

    Returns ({NONE, ALL: Kept}, [problems that the recorders reported], number of records that were dropped).
    """
    contenders, problems, dropped = {NONE: Kept(), ALL: Kept()}, [], 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("127.0.0.1", 0))
        for _ in rounds("measuring", repeats):
            for name, kept in contenders.items():
                with tempfile.TemporaryDirectory() as folder:
                    report = chunk(name, seconds, realtime, folder, listener.getsockname()[1])
                lateness, period = (np.array(report[what], dtype=np.uint64) for what in ("lateness", "period"))
                kept.add(Samples(lateness, period, report["ticks"], report["missed"]))
                problems += report["problems"]
                dropped += report["dropped"]
    return contenders, problems, dropped
