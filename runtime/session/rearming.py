"""A run that may be armed again after a fault: who may ask for that, and what a person is told meanwhile.

The executor waits behind its fence and calls back; what is said goes into the ring as events, and the recorder shows it
at once.
"""

import json
from types import SimpleNamespace

from blocks.safety import Rearm
from cext.safety.shared_state import RECORD_EVENT
from runtime.base.errors import BadInput
from runtime.report.fault import explain, what

NOBODY = (
    "--rearm: nobody could ask for it: here is no terminal for the key r (standard input, output and error), and the "
    "diagram has no Rearm block"
)


def requests(diagram, schedule):
    """{path: slot of the arena} of every input that asks for arming again."""
    return {
        f"{block.path}.request": schedule.inputs[block.path]["request"] for block in diagram if isinstance(block, Rearm)
    }


def check(diagram, wanted, keys):
    """BadInput where --rearm would wait for nobody. keys : whether there is a terminal"""
    if wanted and not keys and not any(isinstance(block, Rearm) for block in diagram):
        raise BadInput(NOBODY)


class Rearming:
    """
    prepared : runtime.session.prepare.Prepared
    keys : whether there is a terminal for the key r
    """

    def __init__(self, prepared, page, control, executor, keys):
        self.prepared, self.page, self.control, self.executor, self.keys = prepared, page, control, executor, keys
        self.slots = requests(prepared.diagram, prepared.schedule)
        self.wanted = prepared.request.rearm or bool(self.slots)
        self.fault, self.report = None, []  # the newest one, and what was told of it

    def options(self):
        """Of Executor.run."""
        return {"rearm": list(self.slots.values()), "told": self.tell} if self.wanted else {}

    def tell(self, kind, outcome):
        """Called by the executor: a fault that may be survived, what stands in the way of arming again, or that it arms
        again.
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
            event["lines"] = [*self.report, f"the run waits in its safe stop: {self.ways()}"]
        elif kind == "refused":
            because = self.in_the_way(outcome)
            event |= {
                "status": outcome.status,
                "culprit": outcome.culprit,
                "lines": [f"not armed again, as the cause stands: {because}"],
            }
        else:
            event["lines"] = [f"arming again at tick {outcome.tick}"]
        self.page.push(RECORD_EVENT, json.dumps(event).encode())

    def ways(self):
        """What may be done now."""
        asked = [f"a rising {name}" for name in self.slots]
        return "; ".join(
            [
                f"{' or '.join((['press r'] if self.keys else []) + asked)} to arm again",
                "space to end" if self.keys else "Ctrl-C to end",
            ]
        )

    def in_the_way(self, outcome):
        moment = self.moment(outcome)
        block = self.prepared.diagram.blocks.get(outcome.culprit)
        return (f"{outcome.culprit}: " if outcome.culprit else "") + what(moment, block, self.control)

    def moment(self, outcome):
        """What a Result would be, had the run ended here. The buses are asked at the end alone."""
        return SimpleNamespace(
            **{
                **vars(self.prepared),
                "rig": None,
                "outcome": outcome,
                "control": self.control,
                "statistics": self.page.statistics(),
                "overruns": self.executor.overruns,
                "newest": self.executor.newest,
                "failed_in_plant": False,
            }
        )

    def told(self, outcome):
        """What there is to tell of a run that ended while it waited; None where it ended otherwise."""
        fault = self.fault
        if fault is None or (outcome.status, outcome.culprit, outcome.tick) != (
            fault.status,
            fault.culprit,
            fault.tick,
        ):
            return None
        return [f"{self.report[0]}; it was not armed again", *self.report[1:]]
