"""A program's own loop between the ticks of a run, which has a process of its own.

The program reads the newest row of the run's ring, and writes live parameters through the mailbox, so that it can do
nothing that `set` cannot. The run ends in its safe stop if the loop ends or raises, if one of its passes takes
longer than `loop_timeout`, and if the program dies.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from cext.recording.newest_row import NewestRow
from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from runtime.host.errors import BadInput, RunFault, UnknownName
from runtime.host.interrupts import interruptible
from runtime.host.live import table
from runtime.host.live.requests import as_text, changes_of
from runtime.host.suggestions import suggestion
from runtime.record.analysis.trial import Trial
from runtime.session.own_process import RunProcess

if TYPE_CHECKING:
    from typing_extensions import Self

TYPES = {"float": float, "int": int, "bool": bool}
POLL_PERIOD = 5e-5  # s, for the next row
ENDED = "the run has ended: connect again"


class ConnectedRobot:
    """Run in real time, on a rig or simulated, whose ticks a program follows.

    begin : function that starts and returns its RunProcess
    loop_timeout : s that one pass of the loop may take

    missed : number of ticks that the loop did not see, since one of its passes took longer than a period
    """

    def __init__(self, begin: Callable[[], RunProcess], loop_timeout: float) -> None:
        if not 0.0 < loop_timeout < math.inf:
            raise BadInput(f"loop_timeout={loop_timeout!r}: expected a finite number of seconds above 0")
        self._begin, self._limit = begin, round(loop_timeout * 1e9)
        self._trial: Trial | None = None
        self._tickets: dict[int, tuple[str, dict[int, float]]] = {}  # {ticket: names and values of the request}
        self.missed = 0

    @interruptible
    def __enter__(self) -> Self:
        """Arm the robot. Raises BadInput if the run did not start, and RunFault for a fault while arming."""
        self._run = self._begin()
        if not self._run.start():
            self._finish()
            raise RunFault(self.trial.fault) if self.trial.fault is not None else BadInput(ENDED)
        shared = self._run.shared
        assert shared is not None
        self._shared, self._writer, self._table = shared, Writer(shared), table.read(shared)
        self._columns = {path: (index, dtype) for index, (path, dtype, _) in enumerate(self._table.signals)}
        self._row = NewestRow(shared, len(self._columns))
        return self

    @interruptible
    def __exit__(self, kind: object, error: object, trace: object) -> None:
        self.close()
        self._run.explain(error)

    def __iter__(self) -> Iterator[int]:
        """Yield each tick after it is done. The run ends with the loop. Raises RunFault after a fault."""
        self._check_running()
        try:
            while self._advance():
                yield self.tick
        finally:
            self._shared.watch_program(0, 0)
            self.close()
        if self.trial.fault is not None:
            raise RunFault(self.trial.fault)

    def _advance(self) -> bool:
        """Wait for the next tick. Returns False if the run has ended."""
        self._shared.watch_program(self._limit, time.monotonic_ns())
        self._take_answers()
        before = self.tick
        due = (self._shared.began + self._shared.first_tick) * 1e-9 + (before + 1) / self.rate
        while not self._row.look():
            if self._run.look(0.0) or self._shared.closed:
                return False
            self._shared.watch_program(self._limit, time.monotonic_ns())  # it waits for the run, not the other way
            time.sleep(max(POLL_PERIOD, min(due - time.monotonic(), 0.5 / self.rate)))
        self._run.look(0.0)
        self.missed += self.tick - before - 1 if before >= 0 else 0
        return True

    def __getitem__(self, path: str) -> Any:
        """Return a signal in the newest tick, or the present value of a live parameter.

        path : such as "left/knee.torque", "imu.gyro" (an array) or "left/profile.scale"

        Raises KeyError with a suggestion for an unknown name, or for a signal that the run does not record.
        """
        if path in self._columns:
            index, dtype = self._columns[path]
            value = self._row.values[index]
            return float(value) if not math.isfinite(value) else TYPES[dtype](value)
        elements = [index for name, (index, _) in self._columns.items() if name.startswith(f"{path}[")]
        if elements:
            return np.array(self._row.values[elements])
        for parameter, (value, _) in zip(
            self._table.parameters, table.values(self._shared, self._table.parameters), strict=True
        ):
            if parameter.path == path:
                return parameter.plain(value)
        known = [*self._columns, *(parameter.path for parameter in self._table.parameters)]
        hint = suggestion(path, known)
        raise UnknownName(f"{self._table.name} records no signal {path!r} and has no such live parameter", hint)

    def __setitem__(self, name: str, value: Any) -> None:
        """Change a live parameter: `set` of one."""
        self.set({name: value})

    def set(self, changes: Mapping[str, Any]) -> None:
        """Change live parameters from the next tick on, all in one tick, within their bounds and at their slew.

        changes : {name of a parameter or pattern such as "*/profile.scale": number, bool, or text with a unit}

        Raises BadInput if a value is outside its bounds, or if the mailbox is full. A change that the run rejects
        raises at the next pass of the loop.
        """
        self._check_running()
        found = [
            (parameter.index, number)
            for name, value in changes.items()
            for parameter, number in changes_of(self._table, name, as_text(value))
        ]
        if len(found) > CHANGE_LIMIT:
            raise BadInput(f"at most {CHANGE_LIMIT} parameters can change in one tick, not {len(found)}")
        ticket = self._writer.set(found)
        if ticket is None:
            raise BadInput("the mailbox of the run is full: set parameters less often, or several in one call")
        self._tickets[ticket] = ", ".join(changes), dict(found)

    def mark(self) -> None:
        """Set a mark in the recording."""
        self._check_running()
        ticket = self._writer.mark()
        if ticket is not None:
            self._tickets[ticket] = "a mark", {}

    def _take_answers(self) -> None:
        for ticket, (words, values) in list(self._tickets.items()):
            answer = self._writer.answer(ticket)
            if answer is None:
                continue
            del self._tickets[ticket]
            if answer[0] not in ("taken", "over"):
                why = "; ".join(self._table.broken(self._shared, values)) or answer[0]
                raise BadInput(f"the run rejected {words} ({why}); nothing was changed")

    @property
    def tick(self) -> int:
        """Newest tick, -1 before the first."""
        return self._row.tick

    @property
    def rate(self) -> float:
        """Rate of the run in Hz."""
        return self._table.rate

    @property
    def time(self) -> float:
        """Time of the newest tick in s."""
        return self.tick / self.rate

    @property
    def state(self) -> str:
        """State of the run, such as "running", or "waiting" after a fault with rearm=True."""
        return "safe" if self._trial is not None else self._shared.state

    @property
    def trial(self) -> Trial:
        """The Trial of the recording. Raises BadInput before the end."""
        if self._trial is None:
            raise BadInput("the run has not ended: leave its `with` block, or call close(), then use its trial")
        return self._trial

    def close(self) -> None:
        """End the run with its safe stop, and wait until its recording is complete. A second call has no effect."""
        if self._trial is None:
            self._run.end()
            self._finish()

    def _finish(self) -> None:
        self._trial = self._run.trial()

    def _check_running(self) -> None:
        if self._trial is not None:
            raise BadInput(ENDED)

    def __repr__(self) -> str:
        return f"<ConnectedRobot {self._table.name}: {self.state}, tick {self.tick}>"
