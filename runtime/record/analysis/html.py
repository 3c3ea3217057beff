"""Description of a Trial for a notebook."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.record.analysis.trial_data import TrialData

REPORT_LINES = 12  # of a fault, that are shown


def trial_in_html(trial: TrialData) -> str:
    """Return how long, what and with which end a Trial is, and a list of its signals to unfold. Reads no signal."""
    about, fault = trial.about, trial.fault
    settings = about["metadata"].get("settings") or {}
    facts = {
        "ticks": f"{len(trial)} at {about['rate']:g} Hz, {len(trial) / about['rate']:g} s",
        "robot": where(about),
        "trial": ", ".join(f"{name}={value}" for name, value in trial.fields.items()),
        "settings": ", ".join(f"{name}={value}" for name, value in settings.items()),
        "file": str(trial.path) if trial.parts else "",
        "ended": (trial.end or {}).get("ended", "the recording has no end"),
        "problem": trial.trouble,
    }
    rows = "".join(
        f'<tr><th style="text-align: left">{name}</th><td style="text-align: left">{escape(text)}</td></tr>'
        for name, text in facts.items()
        if text
    )
    report = "\n".join((fault.get("report") or [])[:REPORT_LINES]) if fault else ""
    problem = f'<pre style="color: #C1121F; line-height: 1.3">{escape(report)}</pre>' if report else ""
    signals = "".join(f"<li><code>{escape(name)}</code> {escape(unit_of(trial, name))}</li>" for name in trial.names)
    return (
        f"<b>{escape(about['name'])}</b><table>{rows}</table>{problem}"
        f"<details><summary>{len(trial.names)} signals</summary><ul>{signals}</ul></details>"
    )


def where(about: dict[str, Any]) -> str:
    """Return whether a run was simulated."""
    time = "virtual time" if about.get("virtual") else "real time"
    return f"simulated, in {time}" if about.get("simulated") else f"not simulated, in {time}"


def unit_of(trial: TrialData, name: str) -> str:
    """Return the unit and the shape of a signal as text."""
    unit, shape = trial.row_of(name)["unit"], trial.find(name)[1]
    return " ".join(filter(None, ["" if unit in ("1", "any") else unit, str(list(shape)) if shape else ""]))
