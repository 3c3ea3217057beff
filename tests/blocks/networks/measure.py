"""Table of docs/reference/networks.md: time of a step of OnnxModel beside the call of ONNX Runtime's session in Python.

python -m tests.blocks.networks.measure [MODEL.onnx...]
"""

import statistics
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from blocks.networks import OnnxModel
from cext.schedule.kernel_table import call_kernel
from tests.blocks.networks import models

CALLS = 3000


def median(function):
    """Median duration of a call in µs, after 100 others."""
    durations = []
    for _ in range(100 + CALLS):
        began = time.perf_counter_ns()
        function()
        durations.append(time.perf_counter_ns() - began)
    return statistics.median(durations[100:]) * 1e-3


def row(path):
    """(µs of the block's step, µs of its inference alone, µs of the session's call) for one file."""
    block = OnnxModel(path)
    block.step(*[0.1] * len(block.inputs))
    scratch = block.scratch
    table = scratch.table(block.kernel)
    step = median(lambda: call_kernel(block.kernel, scratch.arena, table))
    session = models.session(path)
    feeds = {
        each.name: np.zeros([1 if isinstance(length, str) else length for length in each.shape], np.float32)
        for each in session.get_inputs()
    }
    return step, block.inference_times["p50"] * 1e6, median(lambda: session.run(None, feeds))


def main(paths):
    """Print the table, of files or of small models."""
    with tempfile.TemporaryDirectory() as folder:
        paths = paths or [
            models.window(Path(folder) / "window.onnx"),
            models.streaming(Path(folder) / "streaming.onnx"),
            models.temporal(Path(folder) / "temporal_streaming.onnx"),
            models.temporal(Path(folder) / "temporal_window.onnx", window=True),
        ]
        print("| model | step of the block | of which inference | session.run in Python |\n|---|--:|--:|--:|")
        for path in paths:
            print("| {} | {:.1f} µs | {:.1f} µs | {:.1f} µs |".format(Path(path).stem, *row(path)))


if __name__ == "__main__":
    main(sys.argv[1:])
