"""Questions on standard input: what was typed before one is shown does not answer it. Real terminals and processes."""

import os
import time

import pytest

from tests.runtime.runs import ROOT
from tests.runtime.terminals import Terminal
from tests.soaking import soaked

pytestmark = pytest.mark.paced

ASK = """
import sys, time
sys.path.insert(0, sys.argv[1])
from runtime.host.console.confirm import confirm
from runtime.setup.commissioning.configure.joint import until_entered

class Still:
    def angle(self):
        return 0.25

print("begun", flush=True)
time.sleep(0.5)
if sys.argv[2] == "confirm":
    print("answer", confirm("reset the drive", False))
else:
    print("answer", len(until_entered(Still(), "move the joint")) > 10)
"""


@pytest.mark.hazard("H4a")
@pytest.mark.parametrize(
    "kind, shown, answer",
    soaked([("confirm", "reset the drive. yes or no", "no"), ("step", "then press Enter", "")], but=[0]),
)
def test_an_answer_that_was_typed_before_its_question_does_not_count(tmp_path, kind, shown, answer):
    with Terminal() as terminal:
        terminal.start("-c", ASK, ROOT, kind, cwd=tmp_path)
        terminal.wait_for("begun")
        os.write(terminal.master, b"yes\nyes\n")
        terminal.wait_for(shown)
        time.sleep(0.5)
        assert "answer" not in terminal.look().partition(shown[-10:])[2]
        os.write(terminal.master, answer.encode() + b"\n")
        terminal.wait_for("answer " + ("False" if kind == "confirm" else "True"))
        assert terminal.end() == 0
