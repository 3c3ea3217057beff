"""What the keys of the run's terminal do, and what the status line says of it.

space           stop, in the safe stop
Enter           arm, where the run has shown what it found and asks; q ends it there
r               arm again, where the run waits after a fault; q ends it there
Tab, Shift-Tab  choose a live parameter: the next, the one before; what several parts of the diagram have alike, as
both legs have
                profile.scale, is offered first as one, */profile.scale
up, down        a step of about a twentieth of its range
right, left     a tenth of such a step
0               back to the value it was built with
m               mark this moment
s               save the values in a file that `--set @FILE` reads
?               tell the keys
"""

import os

from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from runtime.console.status_layout import part
from runtime.live import patterns, table
from runtime.recording.files import create

ENDING = ".set"
NOTE = 4.0  # s that a note stands in the status line
STEPS = {"up": table.FINE, "down": -table.FINE, "right": 1, "left": -1}
ASKS = {"ready": "Enter arms, space ends", "waiting": "r arms again, space ends"}
HELP = (
    "tickwork: space stops; Tab, Shift-Tab choose a live parameter; up, down a step, right, left a tenth of it; "
    "0 back to the built value; m marks; s saves the values; where the run asks, Enter arms, and r arms again after "
    "a fault"
)


class Panel:
    """
    page : cext.safety.shared_state.SharedState
    keyboard : runtime.console.keys.Keyboard
    recording : runtime.recorder.recording.Recording, beside whose files the values are saved
    """

    def __init__(self, page, keyboard, recording):
        self.page, self.keyboard, self.recording = page, keyboard, recording
        self.table = table.read(page)
        self.choices = choices(self.table.parameters)
        self.writer = Writer(page, "keys")
        self.chosen = None
        self.waiting = {}  # ticket: what to say once it is answered
        self.wanted = {}  # index of a parameter: (ticket, value) that waits
        self.note, self.note_until = "", 0.0
        self.asking = False  # somebody can have read what the run asks

    def look(self, now):
        """Do what was pressed, hear what was answered. now : s, of any steady clock"""
        for ticket in list(self.waiting):
            self.hear(ticket, now)
        for key in self.keyboard.read():
            self.press(key, now)
        self.asking = self.recording.asks  # what was pressed before is no answer

    def press(self, key, now):
        waits = self.page.state in ("ready", "waiting")
        if key == "space" or (key == "q" and waits):
            self.post(self.writer.stop(), "", now)
        elif key == "enter" and self.page.state == "ready" and self.asking:
            self.post(self.writer.confirm(), "", now)
        elif key == "r" and self.page.state == "waiting":
            self.post(self.writer.rearm(), "rearm", now)
        elif key == "r":
            self.say("r arms again after a fault", now)
        elif key == "m":
            self.post(self.writer.mark(), "mark", now)
        elif key == "?":
            self.recording.say(HELP)
        elif key == "s":
            self.save(now)
        elif key in ("tab", "shift tab", "0", *STEPS) and not self.choices:
            self.say("no live parameters", now)
        elif key == "tab":
            self.chosen = 0 if self.chosen is None else (self.chosen + 1) % len(self.choices)
        elif key == "shift tab":
            self.chosen = (self.chosen or 0) - 1 if self.chosen else len(self.choices) - 1
        elif key in ("0", *STEPS) and self.chosen is None:
            self.say("Tab chooses a parameter first", now)
        elif self.chosen is not None and key in ("0", *STEPS):
            _, parameters = self.choices[self.chosen]
            self.change(
                [
                    (
                        parameter,
                        parameter.built if key == "0" else parameter.stepped(self.target(parameter), STEPS[key]),
                    )
                    for parameter in parameters
                ],
                now,
            )

    def target(self, parameter):
        """Where a parameter is going, letters that wait included."""
        return self.wanted[parameter.index][1] if parameter.index in self.wanted else self.values()[parameter.index][1]

    def values(self):
        return table.values(self.page, self.table.parameters)

    def change(self, wanted, now):
        """Post what differs as one letter, which takes effect in one tick. wanted : pairs (Parameter, value)"""
        changes = [(parameter.index, value) for parameter, value in wanted if value != self.target(parameter)]
        if not changes:
            return
        ticket = self.post(self.writer.set(changes), "", now)
        if ticket is not None:
            self.wanted |= {index: (ticket, value) for index, value in changes}

    def post(self, ticket, what, now):
        if ticket is None:
            self.say("too much waits for the loop already", now)
        else:
            self.waiting[ticket] = what
        return ticket

    def hear(self, ticket, now):
        answer = self.writer.answer(ticket)
        if answer is None:
            return
        what = self.waiting.pop(ticket)
        self.wanted = {index: entry for index, entry in self.wanted.items() if entry[0] != ticket}
        verdict, tick, mark = answer
        if verdict not in ("taken", "over") and what != "rearm":  # the run says itself what stands in the way
            self.say(f"refused: {verdict}", now)
        elif what == "mark" and verdict == "taken":
            self.say(f"mark {mark} at tick {tick}", now)

    def save(self, now):
        """The values that parameters have, or are going to, in a file of their own."""
        plan = self.recording.plan
        tick = self.page.statistics()["last_tick"]
        lines = [f"# {self.table.name}: live parameters at tick {tick}; `--set @FILE` reads this"]
        for parameter in self.table.parameters:
            lines.append(f"# {parameter.bounds}; {parameter.description}".rstrip("; "))
            lines.append(f"{parameter.path}={parameter.written(self.target(parameter))}")
        try:
            path, descriptor = create(os.path.join(plan["folder"] or "", plan["stem"]), ENDING)
            with open(descriptor, "w", encoding="utf-8") as file:
                file.write("\n".join(lines) + "\n")
        except OSError as error:
            self.recording.say(
                f"tickwork: cannot save the values: {error.strerror}: {error.filename or plan['folder']}"
            )
            return
        self.recording.saved[path] = f"live parameters at tick {tick}"
        self.recording.say(f"tickwork: saved {path}; --set @{path} starts with these values")

    def say(self, note, now):
        self.note, self.note_until = note, now + NOTE

    def parts(self, now):
        """What the status line shows."""
        parts = [part(8.8, ASKS[self.page.state], colour="bold")] if self.page.state in ASKS else []
        if self.chosen is not None:
            name, parameters = self.choices[self.chosen]
            values = self.values()
            told = list(dict.fromkeys(shown(parameter, *values[parameter.index]) for parameter in parameters))
            bounds = list(dict.fromkeys(parameter.bounds for parameter in parameters))
            parts += [
                part(8.5, f"{name} {', '.join(told)}", colour="bold"),
                part(4.5, f"({', '.join(bounds)})", joined=True),
            ]
        if now < self.note_until:
            parts.append(part(8.2, self.note, colour="yellow"))
        elif self.chosen is None and self.keyboard.taken:
            parts.append(part(1, "? tells the keys", "? keys"))
        return parts

    def close(self):
        self.keyboard.close()


def choices(parameters):
    """[(name, parameters)] that Tab goes through: what several parts have alike, in one, and then each parameter
    alone.
    """
    by_path = {parameter.path: parameter for parameter in parameters}
    together = {
        pattern: [by_path[path] for path in paths]
        for pattern, paths in patterns.shared(by_path).items()
        if len({(by_path[path].dtype, by_path[path].unit) for path in paths}) == 1 and len(paths) <= CHANGE_LIMIT
    }
    return [*together.items(), *((parameter.path, [parameter]) for parameter in parameters)]


def shown(parameter, value, target):
    return parameter.shown(value) + (f" > {parameter.shown(target)}" if value != target else "")
