"""Networks in the reports of a run: durations of inferences, faults, and the time that they may take."""

import re
from pathlib import Path

from runtime.host.console.styles import Console
from runtime.record.report import fault, summary
from runtime.session.check.report import check
from runtime.session.check.text import text
from runtime.session.prepare import prepare
from runtime.session.request import Request
from runtime.session.session import Session
from tests.blocks.networks import models
from tests.runtime.runs import write

ROBOT = """
from blocks.networks import OnnxModel
from blocks.recorders import CsvRecorder
from blocks.sources import Ramp
from graph import Diagram

with Diagram("robot", rate=200) as diagram:
    angle = Ramp(slope=5.0, unit="rad")()
    OnnxModel("m.onnx", name="net")(angle, 0.0, 70.0)
    OnnxModel("m.onnx", name="worker", run="worker", latency=0.02)(angle, 0.0, 70.0)
    CsvRecorder()
"""


def carry_out(folder):
    file = write(folder, ROBOT)
    return Session(prepare(Request(Path(file), duration=0.5, fast=True, no_record=True))).carry_out()


def test_the_summary_has_the_durations_of_inferences_and_late_results(tmp_path):
    models.streaming(tmp_path / "m.onnx")
    lines = [line for line in summary.summary(carry_out(tmp_path)) if " inferences, " in line]
    assert re.fullmatch(r"  blocks      net: 100 inferences, \S+ ms median, \S+ ms p99, \S+ ms max", lines[0])
    # the results of the last 4 ticks, the latency, are not awaited
    assert re.fullmatch(r"              worker: (9[6-9]|100) inferences, .* ms max; 0 results late", lines[1])


def test_a_failed_inference_ends_the_run_with_the_error_of_onnx_runtime(tmp_path):
    models.failing(tmp_path / "m.onnx")
    lines = fault.explain(carry_out(tmp_path))
    assert lines[0].startswith("FAULT at net, tick 40 (0.2 s): the inference failed: ")
    assert "indices element out of data bounds, idx=2" in lines[0]


def test_check_prints_the_time_that_inferences_in_the_tick_may_take(tmp_path):
    models.streaming(tmp_path / "m.onnx")
    report = text(check(Path(write(tmp_path, ROBOT))), Console(200))
    assert "  watchdog allows a tick 20 ms beyond its limit, as its blocks declare" in report
