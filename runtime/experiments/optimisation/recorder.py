"""A recorder with an optimiser as its companion."""

from __future__ import annotations

import os
import socket
from typing import TYPE_CHECKING, Any

from runtime.experiments.optimisation.process import END_TIMEOUT, OptimiserProcess
from runtime.record.recorder import RecorderProcess

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from runtime.record.recorder.plan_types import Plan

SUFFIX = ".optimisation.json"


class OptimisedRecorder(RecorderProcess):
    """Recorder of a run whose live parameters an optimiser process changes. Spawned at once, both connected.

    shared : shared state of the run
    optimiser_plan : plan of runtime.experiments.optimisation.process
    state_path : path of the state file; None for a new one beside the recording

    Raises BadInput if the optimiser cannot start.
    """

    def __init__(self, shared: SharedState, optimiser_plan: dict[str, Any], state_path: str | None = None) -> None:
        self.state_path = state_path
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with ours, theirs:
            self.optimiser = OptimiserProcess(shared, theirs.fileno(), optimiser_plan)
            try:
                super().__init__(shared, companion=ours.fileno())
            except BaseException:
                self.optimiser.end()
                raise

    def configure(self, plan: Plan) -> None:
        """Open every file, as RecorderProcess does, and let the optimiser begin once the robot runs."""
        super().configure(plan)
        if self.state_path is None:
            paths = [file["path"] for file in self.files if file["path"].endswith(".json")]
            self.state_path = paths[-1].removesuffix(".json") + SUFFIX
        self.optimiser.begin(os.path.abspath(self.state_path))

    def keep_to(self, processors: set[int]) -> None:
        """Restrict both processes to processors."""
        super().keep_to(processors)
        self.optimiser.keep_to(processors)

    def finish(self, timeout: float = 60.0) -> dict[str, Any]:
        """Return the report as RecorderProcess does, with `state`, the path of the state file, once both have ended."""
        try:
            return {**super().finish(timeout), "state": self.state_path}
        finally:
            self.optimiser.end(END_TIMEOUT)

    def abandon(self) -> None:
        """End both processes, and remove the files."""
        super().abandon()
        self.optimiser.end()
