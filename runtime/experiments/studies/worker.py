"""Process that runs trials of a study: it reads lines of JSON from standard input and answers each with a row."""

from __future__ import annotations

import json
import os
import sys

from runtime.experiments.studies.trial_row import answer


def main(answers: int, control: int) -> None:
    """Run trials until standard input is closed.

    answers : file descriptor of the pipe for rows
    control : pidfd of the process that runs the study; not used
    """
    description = None
    for line in sys.stdin:
        if not line.endswith("\n"):  # the process that runs the study was killed
            return
        if description is None:
            description = json.loads(line)
            continue
        data = json.dumps(answer(description, json.loads(line))).encode() + b"\n"
        try:
            while data:
                data = data[os.write(answers, data) :]
        except BrokenPipeError:  # the process that runs the study was killed
            return
