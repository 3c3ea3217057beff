"""Engines of a study, which run its trials: in processes of this machine, or in this process."""

from __future__ import annotations

import json
import os
import select
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Generator, Iterable
from contextlib import suppress
from typing import Any

from runtime.experiments.studies.description import Study
from runtime.experiments.studies.objectives import load
from runtime.experiments.studies.trial_row import UserCodeError, trial_row
from runtime.host import diagram_folders
from runtime.host.child_process import ChildProcess
from runtime.host.errors import BadInput

ATTEMPT_LIMIT = 2  # of a trial during which its process ends
ROW_TIMEOUT = 60.0  # s for the rest of a row whose beginning has arrived

Order = tuple[int, dict[str, Any]]  # number of the trial, its parameters


class Engine(ABC):
    """Engine that runs trials of one study, as often as it is called. As a context it ends its processes."""

    @abstractmethod
    def run(self, orders: Iterable[Order]) -> Generator[dict[str, Any], None, None]:
        """Run trials and yield their rows as they end. Raises BadInput for an exception in user code."""

    def close(self) -> None:  # noqa: B027  # an engine without processes has nothing to end
        """End the processes of the engine."""

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()


class Here(Engine):
    """Engine that runs trials in this process, in order."""

    def __init__(self, study: Study) -> None:
        self._study = study
        self._objectives = {name: load(name, given) for name, given in study.objectives.items()}

    def run(self, orders: Iterable[Order]) -> Generator[dict[str, Any], None, None]:
        for number, parameters in orders:
            try:
                row = trial_row(self._study.diagram, self._study.run_of(parameters), self._objectives)
            except UserCodeError as error:
                raise BadInput(failure_text(number, parameters, str(error))) from error
            yield {"trial": number, **row}


class Processes(Engine):
    """Engine that runs trials in processes of this machine. A trial whose process ends is run again once.

    study : study with names of the diagram and the objectives, not functions
    count : number of processes
    """

    def __init__(self, study: Study, count: int) -> None:
        self._study, self._count = study, count
        diagram_folders.import_from(os.path.dirname(os.path.realpath(study.diagram)))  # the children have its path
        self._idle: list[Worker] = []

    def run(self, orders: Iterable[Order]) -> Generator[dict[str, Any], None, None]:
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
                self._idle.append(worker)

        try:
            for _ in range(min(self._count, len(waiting))):
                start(self._idle.pop() if self._idle else Worker(self._study))
            while running:
                for descriptor, _ in poll.poll():
                    worker, order = running.pop(descriptor)
                    poll.unregister(descriptor)
                    row = worker.row()
                    if row is None:
                        worker.end()
                        if attempts[order[0]] >= ATTEMPT_LIMIT:
                            raise BadInput(
                                failure_text(*order, "its process was killed or crashed. Run this trial by itself")
                            )
                        waiting.appendleft(order)
                        worker = Worker(self._study)
                    elif "stop" in row:
                        worker.end()
                        raise BadInput(failure_text(*order, row["stop"]))
                    start(worker)
                    if row is not None:
                        yield row
        finally:
            for worker, _ in running.values():
                worker.end()

    def close(self) -> None:
        while self._idle:
            self._idle.pop().end()


def failure_text(number: int, parameters: dict[str, Any], reason: str) -> str:
    """Return the message about a trial that stops the study."""
    values = ", ".join(f"{name}={value}" for name, value in parameters.items())
    return f"trial {number}{f' ({values})' if values else ''}: {reason}"


class Worker(ChildProcess):
    """Process runtime.experiments.studies.worker.

    answers : file descriptor that is readable when a row is complete or the process has ended
    """

    def __init__(self, study: Study) -> None:
        super().__init__("runtime.experiments.studies.worker", (), ())
        self.answers = self._answers
        self._order(study.content())

    def run(self, order: Order) -> None:
        """Start a trial."""
        self._order(order)

    def row(self) -> dict[str, Any] | None:
        """Return the row of the trial; None if the process has ended."""
        return self._answer(ROW_TIMEOUT)

    def _order(self, order):
        with suppress(BrokenPipeError):  # `row` reports it
            self._send(json.dumps(order).encode() + b"\n")
