"""What `bench` prints: tables as it goes, goals at the end; or all of it as one JSON text."""

import json
import os
import platform

from runtime.console.terminal import tell


def machine():
    return {"python": platform.python_version(), "machine": platform.machine(), "processors": os.cpu_count()}


def words():
    return ["Python {python} on {machine}, {processors} processors".format(**machine())]


class Report:
    """Prints as it goes, or gathers for one JSON text at the end."""

    def __init__(self, for_machines):
        self.for_machines = for_machines
        self.data = {}
        self.goals = []

    def say(self, lines, **data):
        self.data |= data
        if not self.for_machines:
            tell(lines)

    def finish(self):
        if self.for_machines:
            found = [
                {
                    "what": g.what,
                    "value": g.value,
                    "goal": g.bound,
                    "unit": g.unit,
                    "at_least": g.at_least,
                    "reached": g.reached,
                }
                for g in self.goals
            ]
            tell([json.dumps({**self.data, "goals": found}, indent=1, ensure_ascii=False)])
            return
        lines = ["", f"{'goals':46}{'found':>12}{'wanted':>18}"]
        for goal in self.goals:
            bound = f"{'at least' if goal.at_least else 'at most'} {goal.bound:.3g}"
            lines.append(
                f"  {goal.what:44}{goal.value:12.3g}{bound:>18} "
                f"{goal.unit:10}{'' if goal.reached else 'not reached'}".rstrip()
            )
        tell(lines)
