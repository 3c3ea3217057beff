"""Arming again after a fault: the requests for it, and the events while the run waits.

The executor waits in its safe stop and calls back. Each event goes into the ring, and the recorder prints it at once.
"""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

from blocks.safety import Rearm
from cext.memory.shared_state import RECORD_EVENT
from runtime.record.report.fault import explain, what

if TYPE_CHECKING:
    from cext.memory.shared_state import SharedState
    from cext.schedule.executor import Executor
    from cext.schedule.outcome import Outcome
    from cext.schedule.program import Program
    from graph import Diagram, Schedule
    from runtime.session.prepare import Prepared


def requests(diagram: Diagram, schedule: Schedule) -> dict[str, int]:
    """Return {path: slot of the arena} of the inputs that request arming again."""
    return {
        f"{block.path}.request": schedule.inputs[block.path]["request"] for block in diagram if isinstance(block, Rearm)
    }


class Rearming:
    """The requests for arming again, and the report of the fault before.

    prepared : runtime.session.prepare.Prepared
    keys : whether there is a terminal for the key r
    """

    def __init__(
        self, prepared: Prepared, shared: SharedState, control: Program, executor: Executor, keys: bool
    ) -> None:
        self.prepared, self.shared, self.control = prepared, shared, control
        self.executor, self.keys = executor, keys
        self.slots = requests(prepared.diagram, prepared.schedule)
        self.enabled = prepared.request.rearm or bool(self.slots)
        self.fault, self.report = None, []  # Outcome of the newest fault, and its lines

    def options(self) -> dict[str, Any]:
        """Return the options of Executor.run."""
        return {"rearm": list(self.slots.values()), "notify": self.publish} if self.enabled else {}

    def publish(self, kind: str, outcome: Outcome) -> None:
        """Publish an event. Called by the executor.

        kind : "fault", "refused" (a request while the cause persists) or "rearm"
        """
        event = {
            "event": {"fault": "fault", "refused": "rearm refused", "rearm": "armed again"}[kind],
            "tick": outcome.tick,
        }
        if kind == "fault":
            self.fault, self.report = outcome, explain(self.moment(outcome))
            event |= {
                "status": outcome.status,
                "culprit": outcome.culprit,
                "late": self.control.late,
                "report": self.report,
            }
            event["lines"] = [*self.report, f"the run waits in its safe stop: {self.instructions()}"]
        elif kind == "refused":
            cause = self.cause(outcome)
            event |= {
                "status": outcome.status,
                "culprit": outcome.culprit,
                "lines": [f"not armed again, the cause persists: {cause}"],
            }
        else:
            event["lines"] = [f"arming again at tick {outcome.tick}"]
        if kind != "rearm":
            event["question"] = self.shared.question
        self.shared.push(RECORD_EVENT, json.dumps(event).encode())

    def instructions(self) -> str:
        """Return the text of what the operator can do now."""
        inputs = [f"a rising {name}" for name in self.slots]
        return "; ".join(
            [
                f"{' or '.join((['press r'] if self.keys else []) + inputs)} to arm again",
                "space to end" if self.keys else "Ctrl-C to end",
            ]
        )

    def cause(self, outcome: Outcome) -> str:
        """Return the text of the fault that prevents arming again."""
        moment = self.moment(outcome)
        block = self.prepared.diagram.blocks.get(outcome.culprit or "")
        return (f"{outcome.culprit}: " if outcome.culprit else "") + what(moment, block, self.control)

    def moment(self, outcome: Outcome) -> Any:
        """Return the fields of a Result as if the run had ended now, without the report of its rig."""
        return SimpleNamespace(
            **{
                **vars(self.prepared),
                "rig": None,
                "shared": self.shared,
                "outcome": outcome,
                "control": self.control,
                "statistics": self.shared.statistics(),
                "overruns": self.executor.overruns,
                "newest": self.executor.newest,
                "failed_in_plant": False,
            }
        )

    def report_of(self, outcome: Outcome) -> list[str] | None:
        """Return the lines of a run that ended while it waited after a fault; None for any other end."""
        fault = self.fault
        if fault is None or (outcome.status, outcome.culprit, outcome.tick) != (
            fault.status,
            fault.culprit,
            fault.tick,
        ):
            return None
        return [f"{self.report[0]}; it was not armed again", *self.report[1:]]
