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
    description = json.loads(sys.stdin.readline())
    for line in sys.stdin:
        data = json.dumps(answer(description, json.loads(line))).encode() + b"\n"
        try:
            while data:
                data = data[os.write(answers, data) :]
        except BrokenPipeError:  # the process that runs the study was killed
            return
