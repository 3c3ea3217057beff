"""Process that runs trials of a study: it reads lines of JSON from standard input and answers each with a row."""

from __future__ import annotations

import json
import os
import sys

from runtime.studies.description import described
from runtime.studies.objectives import load
from runtime.studies.trial_row import UserCodeError, trial_row


def main(answers: int, control: int) -> None:
    """Run trials until standard input is closed.

    answers : file descriptor of the pipe for rows
    control : pidfd of the process that runs the study; not used
    """
    study = described(json.loads(sys.stdin.readline()))
    objectives = {name: load(name, given) for name, given in study.objectives.items()}
    for line in sys.stdin:
        order = json.loads(line)
        try:
            row = trial_row(study.diagram, study.run_of(order["parameters"]), objectives)
        except UserCodeError as error:
            row = {"stop": str(error)}
        data = json.dumps({"trial": order["trial"], **row}).encode() + b"\n"
        while data:
            data = data[os.write(answers, data) :]
