"""Engine of a study: it runs trials in processes of this machine, or in this process."""

from __future__ import annotations

import json
import os
import select
from collections import Counter, deque
from collections.abc import Generator, Iterable
from contextlib import suppress
from typing import Any

from runtime.base.child_process import ChildProcess
from runtime.base.errors import BadInput
from runtime.studies.description import Study
from runtime.studies.objectives import load
from runtime.studies.trial_row import UserCodeError, trial_row

ATTEMPT_LIMIT = 2  # of a trial during which its process ends
ROW_TIMEOUT = 60.0  # s for the rest of a row whose beginning has arrived

Order = tuple[int, dict[str, Any]]  # number of the trial, its parameters


def run_here(study: Study, orders: Iterable[Order]) -> Generator[dict[str, Any], None, None]:
    """Run trials in this process and yield their rows, in order. Raises BadInput for an exception in user code."""
    objectives = {name: load(name, given) for name, given in study.objectives.items()}
    for number, parameters in orders:
        try:
            row = trial_row(study.diagram, study.run_of(parameters), objectives)
        except UserCodeError as error:
            raise BadInput(failed(number, parameters, str(error))) from error
        yield {"trial": number, **row}


def run_in_processes(study: Study, orders: Iterable[Order], workers: int) -> Generator[dict[str, Any], None, None]:
    """Run trials in processes and yield their rows as they end. A trial whose process ends is run again once.

    study : with names of the diagram and the objectives, not functions
    workers : number of processes

    Raises BadInput for an exception in user code, and for a trial that ends its process again.
    """
    waiting, attempts = deque(orders), Counter()
    running: dict[int, tuple[Worker, Order]] = {}
    poll = select.poll()

    def start(worker: Worker) -> None:
        if waiting:
            order = waiting.popleft()
            attempts[order[0]] += 1
            running[worker.answers] = worker, order
            poll.register(worker.answers, select.POLLIN)
            worker.run(order)
        else:
            worker.end()

    try:
        for _ in range(min(workers, len(waiting))):
            start(Worker(study))
        while running:
            for descriptor, _ in poll.poll():
                worker, order = running.pop(descriptor)
                poll.unregister(descriptor)
                row = worker.row()
                if row is None:
                    worker.end()
                    if attempts[order[0]] >= ATTEMPT_LIMIT:
                        raise BadInput(failed(*order, "its process was killed or crashed. Run this trial by itself"))
                    waiting.appendleft(order)
                    worker = Worker(study)
                elif "stop" in row:
                    worker.end()
                    raise BadInput(failed(*order, row["stop"]))
                start(worker)
                if row is not None:
                    yield row
    finally:
        for worker, _ in running.values():
            worker.end()


def failed(number: int, parameters: dict[str, Any], reason: str) -> str:
    """Return the message about a trial that stops the study."""
    values = ", ".join(f"{name}={value}" for name, value in parameters.items())
    return f"trial {number} ({values}): {reason}"


class Worker(ChildProcess):
    """Process runtime.studies.worker.

    answers : file descriptor that is readable when a row is complete or the process has ended
    """

    def __init__(self, study: Study) -> None:
        super().__init__("runtime.studies.worker", (), ())
        self.answers = self._answers
        self._order(study.content())

    def run(self, order: Order) -> None:
        """Start a trial."""
        self._order(order)

    def row(self) -> dict[str, Any] | None:
        """Return the row of the trial; None if the process has ended."""
        return self._answer(ROW_TIMEOUT)

    def end(self) -> None:
        """Kill the process."""
        self._child.kill()
        self._child.wait()
        os.close(self._answers)
        with suppress(BrokenPipeError):  # of an order that it has not read
            self._orders.close()

    def _order(self, order):
        with suppress(BrokenPipeError):  # `row` reports it
            self._send(json.dumps(order).encode() + b"\n")
