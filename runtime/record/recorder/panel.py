"""Keys of the run's terminal, and their part of the status line.

space           stop the run with the safe stop; the control process, which reads the keys, has done so already
Enter           confirm the pre-flight table and arm; q ends the run instead
r               arm again after a fault; q ends the run instead
Tab, Shift-Tab  select the next or previous live parameter. Parameters that subsystems have in common, such as
                */profile.scale of both legs, come first and change together
up, down        a step of about a twentieth of the range
right, left     a tenth of such a step
0               reset to the value in the diagram
m               mark this tick
s               save the values in a file for `--set @FILE`
?               list the keys
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterable
from typing import Any

from cext.safety.thresholds import CONSENT_LIMIT
from cext.schedule.mailbox_writer import CHANGE_LIMIT, Writer
from runtime.host.console.keys import Key
from runtime.host.console.status_layout import part
from runtime.host.live import patterns, table
from runtime.host.replaced_file import write
from runtime.record.storage.files import create

SAVED_SUFFIX = ".set"
NOTE_DURATION = 4.0  # s, of a note in the status line
LETTER_LIMIT = 8  # requests that wait for the loop; further changes are put together
POST_LIMIT = 2.0  # s in which the mailbox must have room for a change
STEPS = {"up": table.FINE, "down": -table.FINE, "right": 1, "left": -1}
PROMPTS = {"ready": "Enter arms, space ends", "waiting": "r arms again, space ends"}
CONFIRMING = {("enter", "ready"), ("r", "waiting")}
HELP = (
    "tickwork: space: stop; Tab, Shift-Tab: select a live parameter;",
    "  up, down: change it by a step; right, left: by a tenth of a step; 0: reset it;",
    "  m: mark; s: save the values; at the pre-flight table Enter: arm, q: end;",
    "  after a fault r: arm again, q: end",
)


class Panel:
    """Keys of one run.

    shared : cext.memory.shared_state.SharedState
    keyboard : runtime.host.console.keys.Keyboard
    recording : runtime.record.recorder.part.Recording, beside whose files the values are saved
    companion : runtime.record.recorder.companion.Companion, which takes the keys that it uses while the run is armed;
        or None
    """

    def __init__(self, shared, keyboard, recording, companion=None):
        self.shared, self.keyboard = shared, keyboard
        self.recording, self.companion = recording, companion
        self.table = table.read(shared)
        self.choices = choices(self.table.parameters)
        self.writer = Writer(shared, "keys")
        self.chosen = None
        self.waiting = {}  # ticket: kind of request
        self.pending = {}  # index of a parameter: (ticket, value)
        self.wanted = []  # [(s of the first change, {index of a parameter: value})] that the mailbox has no room for
        self.note, self.note_until = "", 0.0

    def look(self, now: float) -> None:
        """Take the answers of the loop, then the pressed keys. now : s, of any monotonic clock"""
        for ticket in list(self.waiting):
            self.take_answer(ticket, now)
        self.post_wanted(now)
        for key in self.keyboard.read():
            if (key.name, self.shared.state) in CONFIRMING:
                self.confirm(key, now)
            else:
                self.press(key, now)

    def confirm(self, key: Key, now: float) -> None:
        """Confirm that the robot may be armed, if the key was pressed after the question was shown. now : s"""
        question, age = self.shared.question, time.monotonic_ns() - key.read
        if not key.question == self.recording.question == question or key.since < self.recording.shown_at:
            self.say(f"{key.name} was pressed before the question was shown: press it again", now)
        elif age > CONSENT_LIMIT:
            self.say(f"{key.name} was pressed {age * 1e-9:.1f} s ago: press it again", now)
        else:
            self.writer.confirm(question, key.read)

    def press(self, pressed: Key, now: float) -> None:
        """Carry out the command of a key. now : s"""
        key, waits = pressed.name, self.shared.state in ("ready", "waiting")
        if key == "space" or (key == "q" and waits):
            pass  # the run is being stopped
        elif self.companion is not None and not waits and self.companion.press(key, pressed):
            pass
        elif key == "r":
            self.say("r arms again after a fault", now)
        elif key == "m":
            self.mark(now)
        elif key == "?":
            for line in HELP:
                self.recording.say(line)
            if self.companion is not None and self.companion.needs["help"]:
                self.recording.say(f"tickwork: {self.companion.needs['help']}")
        elif key == "s":
            self.save(now)
        elif key in ("tab", "shift tab", "0", *STEPS) and not self.choices:
            self.say("no live parameters", now)
        elif key == "tab":
            self.chosen = 0 if self.chosen is None else (self.chosen + 1) % len(self.choices)
        elif key == "shift tab":
            self.chosen = (self.chosen or 0) - 1 if self.chosen else len(self.choices) - 1
        elif key == "enter" and self.chosen is not None:
            self.say("up and down change it", now)
        elif key in ("0", *STEPS) and self.chosen is None:
            self.say("select a parameter first with Tab", now)
        elif self.chosen is not None and key in ("0", *STEPS):
            _, parameters = self.choices[self.chosen]
            self.change(
                [
                    (
                        parameter,
                        parameter.built if key == "0" else parameter.next_step(self.target(parameter), STEPS[key]),
                    )
                    for parameter in parameters
                ],
                now,
            )

    def target(self, parameter: Any) -> float:
        """Return the value that a parameter will have after all pending changes."""
        for _, changes in reversed(self.wanted):
            if parameter.index in changes:
                return changes[parameter.index]
        return (
            self.pending[parameter.index][1] if parameter.index in self.pending else self.values()[parameter.index][1]
        )

    def values(self) -> list[tuple[float, float]]:
        """Return (value, target) of each live parameter."""
        return table.values(self.shared, self.table.parameters)

    def change(self, pairs: list[tuple[Any, float]], now: float) -> None:
        """Post the differing values as one request, which takes effect in one tick. pairs : (Parameter, value)"""
        changes = {parameter.index: value for parameter, value in pairs if value != self.target(parameter)}
        if not changes:
            return
        same = next((wanted for _, wanted in self.wanted if wanted.keys() == changes.keys()), None)
        if same is None:
            self.wanted.append((now, changes))
        else:  # the newest value counts
            same.update(changes)
        self.post_wanted(now)

    def post_wanted(self, now: float) -> None:
        """Post the changes that wait for room in the mailbox, and report one that has waited for too long. now : s"""
        while self.wanted and len(self.waiting) < LETTER_LIMIT:
            since, changes = self.wanted[0]
            ticket = self.writer.set(list(changes.items()))
            if ticket is None:
                if now - since > POST_LIMIT:
                    names = ", ".join(self.table.parameters[index].path for index in changes)
                    self.recording.say(f"tickwork: {names} was not changed: the mailbox of the run is full")
                    self.wanted.pop(0)
                return
            self.waiting[ticket] = ""
            self.pending |= {index: (ticket, value) for index, value in changes.items()}
            self.wanted.pop(0)

    def mark(self, now: float) -> None:
        """Mark this tick. now : s"""
        ticket = self.writer.mark()
        if ticket is None:
            self.say("no mark was set: the mailbox of the run is full", now)
        else:
            self.waiting[ticket] = "mark"

    def take_answer(self, ticket: int, now: float) -> None:
        """Show the answer to a request, if it has arrived. now : s"""
        answer = self.writer.answer(ticket)
        if answer is None:
            return
        what = self.waiting.pop(ticket)
        changes = {index: value for index, (other, value) in self.pending.items() if other == ticket}
        self.pending = {index: entry for index, entry in self.pending.items() if entry[0] != ticket}
        verdict, tick, mark = answer
        if verdict not in ("taken", "over"):
            self.say(f"rejected: {'; '.join(self.table.broken(self.shared, changes)) or verdict}", now)
        elif what == "mark" and verdict == "taken":
            self.say(f"mark {mark} at tick {tick}", now)

    def save(self, now: float) -> None:
        """Save the values of all parameters, after pending changes, in a file."""
        plan = self.recording.plan
        tick = self.shared.statistics()["last_tick"]
        lines = [f"# {self.table.name}: live parameters at tick {tick}; `--set @FILE` reads this"]
        for parameter in self.table.parameters:
            lines.append(f"# {parameter.bounds}; {parameter.description}".rstrip("; "))
            lines.append(f"{parameter.path}={parameter.setting_text(self.target(parameter))}")
        try:
            path, descriptor = create(os.path.join(plan["folder"] or "", plan["stem"]), SAVED_SUFFIX)
            os.close(descriptor)
            write(path, "\n".join(lines) + "\n")
        except OSError as error:
            self.recording.say(
                f"tickwork: cannot save the values: {error.strerror}: {error.filename or plan['folder']}"
            )
            return
        self.recording.saved[path] = f"live parameters at tick {tick}"
        self.recording.say(f"tickwork: saved {path}; --set @{path} starts with these values")

    def say(self, note: str, now: float) -> None:
        """Show a note in the status line for NOTE_DURATION. now : s"""
        self.note, self.note_until = note, now + NOTE_DURATION

    def parts(self, now: float) -> list[Any]:
        """Return the parts of the status line."""
        asks = self.shared.state in PROMPTS and self.recording.question == self.shared.question
        parts = [part(8.8, PROMPTS[self.shared.state], colour="bold")] if asks else []
        if self.companion is not None:
            parts += self.companion.parts()
        if self.chosen is not None:
            name, parameters = self.choices[self.chosen]
            values = self.values()
            texts = list(dict.fromkeys(shown(parameter, *values[parameter.index]) for parameter in parameters))
            bounds = list(dict.fromkeys(parameter.bounds for parameter in parameters))
            parts += [
                part(8.5, f"{name} {', '.join(texts)}", colour="bold"),
                part(4.5, f"({', '.join(bounds)})", joined=True),
            ]
        if self.keyboard.in_foreground and self.shared.state not in PROMPTS:
            parts.insert(0, part(8.9, "space stops"))
        if now < self.note_until:
            parts.append(part(8.2, self.note, colour="yellow"))
        elif self.chosen is None and self.keyboard.in_foreground:
            parts.append(part(1, "? lists the keys", "? keys"))
        return parts


def choices(parameters: Iterable[Any]) -> list[tuple[str, list[Any]]]:
    """Return [(name, parameters)] in the order of Tab: common parameters of subsystems, then each parameter."""
    by_path = {parameter.path: parameter for parameter in parameters}
    together = {
        pattern: [by_path[path] for path in paths]
        for pattern, paths in patterns.shared_patterns(by_path).items()
        if len({(by_path[path].dtype, by_path[path].unit) for path in paths}) == 1 and len(paths) <= CHANGE_LIMIT
    }
    return [*together.items(), *((parameter.path, [parameter]) for parameter in parameters)]


def shown(parameter: Any, value: float, target: float) -> str:
    """Return the value of a parameter as text, and its target if that differs."""
    return parameter.value_text(value) + (f" > {parameter.value_text(target)}" if value != target else "")
