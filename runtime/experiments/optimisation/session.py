"""A run with an optimiser as its companion."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Any

from runtime.experiments.optimisation.process import END_TIMEOUT, OptimiserProcess
from runtime.record.recorder import RecorderProcess
from runtime.session.session import Session

if TYPE_CHECKING:
    from cext.schedule.outcome import Outcome
    from runtime.session.prepare import Prepared
    from runtime.session.result import Result

SUFFIX = ".optimisation.json"


class OptimisedSession(Session):
    """Run whose live parameters an optimiser process changes.

    prepared, say : as in Session
    plan : plan of runtime.experiments.optimisation.process
    state_path : path of the state file; None for a new one beside the recording

    state_path : path of the state file, once it is armed
    """

    def __init__(
        self,
        prepared: Prepared,
        say: Callable[[list[str]], object],
        plan: dict[str, Any],
        state_path: str | None = None,
    ) -> None:
        super().__init__(prepared, say)
        self.optimiser_plan, self.state_path = plan, state_path
        self.optimiser: OptimiserProcess | None = None

    def recorder_of(self) -> RecorderProcess:
        """Start the optimiser and the recorder, connected. Returns the recorder. Raises BadInput."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours, theirs:
            self.optimiser = OptimiserProcess(self.shared, theirs.fileno(), self.optimiser_plan)
            self.recorder_process = RecorderProcess(self.shared, companion=ours.fileno())
            return self.recorder_process

    def keep_others_aside(self) -> Collection[int]:
        aside = super().keep_others_aside()
        if self.realtime.others and self.optimiser is not None:
            self.optimiser.keep_to(self.realtime.others)
        return aside

    def arm(self) -> None:
        """Take everything that the run needs, as Session does. Raises BadInput if the optimiser cannot start."""
        try:
            super().arm()
        except BaseException:
            if self.optimiser is not None:
                self.optimiser.end()
            raise
        assert self.optimiser is not None
        if self.state_path is None:
            paths = [file["path"] for file in self.recorder_process.files if file["path"].endswith(".json")]
            self.state_path = paths[-1].removesuffix(".json") + SUFFIX
        self.optimiser.begin(os.path.abspath(self.state_path))

    def finish(self, outcome: Outcome | None, seconds: float) -> Result | None:
        """Complete the recording as Session does, then wait for the end of the optimiser."""
        try:
            return super().finish(outcome, seconds)
        finally:
            if self.optimiser is not None:
                self.optimiser.end(END_TIMEOUT)
