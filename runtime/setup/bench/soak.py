"""Hours of a rig at zero torque, in spells: replies, lateness, heat, clocks and card, one line of a report each.

A spell is a run as of `rate`, with guardian, recorder and safe stop. Every second one has every processor busy. The
report is written after each, so that it survives whatever ends the computer.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.host.machine.finding import Wants
from runtime.host.machine.thermal import thermal
from runtime.host.replaced_file import write
from runtime.record.storage.provenance import processor, versions
from runtime.setup.bench.clock import busy_processors
from runtime.setup.bench.report import lateness
from runtime.setup.doctor import examine
from runtime.setup.doctor.power import throttling

if TYPE_CHECKING:
    from runtime.host.machine.probe import Machine
    from runtime.setup.bench.rate.steps import OnRig

LEFT = 1 << 20  # bytes that are free on a card that was filled
JUMP = 0.01  # s by which the system clock may depart from the steady one in a spell


class Soak:
    """Spells of one rig.

    attempt : OnRig that carries out a spell, with a folder for its recordings
    rate : Hz
    path : path of the report
    machine : Machine

    report : what was found so far, as plain data
    """

    def __init__(self, attempt: OnRig, rate: float, path: Path, machine: Machine) -> None:
        assert attempt.folder is not None
        self.attempt, self.rate, self.path, self.machine = attempt, rate, path, machine
        self.folder = attempt.folder
        self.report: dict[str, Any] = {
            "rig": attempt.rig.path.name,
            "rate": rate,
            "actuators": len(attempt.ids),
            "computer": processor(),
            "kernel": machine.kernel,
            "versions": versions(),
            "findings": [f"{each.name}: {each.found}" for each in examine(machine, Wants()) if each.verdict != "ok"],
            "complete": False,
            "spells": [],
        }

    def run(self, seconds: float, say: Callable[[str], object], full_card: bool = False) -> bool:
        """Carry out spells until this time in s has passed. Returns whether none had a fault or lost anything.

        say : shows the line of a spell; full_card : whether the card is full in the last one
        """
        until = time.monotonic() + seconds
        while True:
            last = time.monotonic() + self.attempt.seconds >= until
            spell = self.spell(busy=len(self.report["spells"]) % 2 == 1, full=full_card and last)
            self.report["spells"].append(spell)
            self.report |= {"hours": seconds / 3600.0, "complete": last and not spell["why"]}
            write(self.path, json.dumps(self.report, indent=1, ensure_ascii=False) + "\n")
            say(in_words(spell))
            if last or spell["why"]:
                return not any(failed(each) for each in self.report["spells"])

    def spell(self, busy: bool, full: bool) -> dict[str, Any]:
        """Carry out one spell, whose recording stays if something was lost. busy : whether every processor is busy"""
        folder = self.attempt.folder = self.folder / f"spell{1 + len(self.report['spells'])}"
        folder.mkdir(parents=True)
        clocks = read_clocks()
        with busy_processors() if busy else nullcontext(), filled(folder) if full else nullcontext():
            step = self.attempt(self.rate)
        steady, wall, boot = (after - before for before, after in zip(clocks, read_clocks()))
        result = self.attempt.result
        assert result is not None and result.shared is not None
        late = result.shared.counts("lateness")
        throttled = throttling(self.machine, Wants())
        spell = {
            "at": time.strftime("%Y-%m-%d %H:%M:%S"),
            "seconds": round(steady, 1),
            "busy": busy,
            "full card": full,
            "commands": step.commands,
            "missed replies": step.missed,
            "lost ticks": step.lost,
            "why": step.why,
            "late p99": lateness(late, 0.99) if late.any() else None,
            "late max": lateness(late, 1.0) if late.any() else None,
            "clock jump": wall - steady if abs(wall - steady) > JUMP else 0.0,
            "suspended": max(0.0, boot - steady) if boot - steady > JUMP else 0.0,
            "dropped records": result.statistics["dropped"],
            "problems of the recording": result.recording["problems"],
            "free": shutil.disk_usage(folder).free,
            "throttling": None if throttled is None else throttled.found,
            **thermal(self.machine),
        }
        if not failed(spell):
            shutil.rmtree(folder)
        return spell


def failed(spell: dict[str, Any]) -> bool:
    """Return whether a spell has lost something: records count where the card was not filled on purpose."""
    records = not spell["full card"] and (spell["dropped records"] or spell["problems of the recording"])
    return bool(spell["why"] or spell["missed replies"] or spell["lost ticks"] or records)


def in_words(spell: dict[str, Any]) -> str:
    """Return a spell as one line."""
    late, jump, hottest = spell["late max"], spell["clock jump"], max(spell["temperatures"].values(), default=None)
    words = {
        f"{spell['at'][11:]} {spell['seconds']:g} s": True,
        "every processor busy": spell["busy"],
        "full card": spell["full card"],
        f"{spell['missed replies']} of {spell['commands']} replies missed, {spell['lost ticks']} ticks lost": True,
        f"late by at most {1e3 * (late or 0.0):.2g} ms": late is not None,
        f"clock jumped by {jump:+.3g} s": jump,
        f"suspended for {spell['suspended']:.3g} s": spell["suspended"],
        f"{hottest or 0.0:.0f} °C": hottest is not None,
        f"throttling {spell['throttling']}": spell["throttling"] is not None,
        "; ".join(spell["problems of the recording"]): spell["problems of the recording"],
        f"ENDED: {spell['why']}": spell["why"],
    }
    return ", ".join(text for text, shown in words.items() if shown)


def read_clocks() -> tuple[float, float, float]:
    """Return the steady clock, the system clock, and the steady clock that a suspend does not stop, s."""
    return time.monotonic(), time.time(), time.clock_gettime(time.CLOCK_BOOTTIME)


@contextmanager
def filled(folder: Path) -> Iterator[None]:
    """Context manager in which the file system of a folder is full but for LEFT bytes, by a file without a name.

    The system frees it, however this process ends.
    """
    with tempfile.TemporaryFile(dir=folder) as file:
        size = shutil.disk_usage(folder).free - LEFT
        if size > 0:
            os.posix_fallocate(file.fileno(), 0, size)
        yield
