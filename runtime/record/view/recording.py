"""One recording, as pages show it: its description, its events in words, and windows of its signals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from runtime.record.analysis import names
from runtime.record.view.levels import Levels

if TYPE_CHECKING:
    from collections.abc import Iterator

    from runtime.record.analysis.trial import Trial

AUTHORS = {"keys": "keys of the terminal", "replay": "the replay", "step": "the script"}
STATES = {"stop": "Stop", "confirm": "Arming was confirmed", "rearm": "Arming again was confirmed"}


class Recording:
    """One recording, which has been checked.

    trial : Trial
    label : name among the recordings of the page

    levels : Levels of its signals
    """

    def __init__(self, trial: Trial, label: str) -> None:
        self.trial, self.label, self.levels = trial, label, Levels(trial)
        limits, states = trial.about.get("limits", {}), trial.about.get("states", {})
        self.signals = names.describe(
            {key: signal[key] for key in ("path", "unit", "dtype")}
            | {"limits": limits.get(signal["path"]), "labels": states.get(signal["path"], [])}
            for signal in trial.about["signals"]
        )

    def describe(self) -> dict[str, Any]:
        """Return what a page needs once, for JSON. Times are in s"""
        trial, about = self.trial, self.trial.about
        return {
            "label": self.label,
            "name": about["name"],
            "file": trial.path.name,
            "rate": about["rate"],
            "ticks": len(trial),
            "begin": float(trial.time[0]) if len(trial) else 0.0,
            "end": float(trial.time[-1]) if len(trial) else 0.0,
            "simulated": bool(about.get("simulated")),
            "began": trial.began / 1e6,  # ms of the wall clock
            "fields": trial.fields,
            "signals": self.signals,
            "events": list(self.events()),
            "gaps": trial.gaps,
            "trouble": trial.trouble,
            "unverified": trial.unverified,
            "fault": self.fault(),
        }

    def fault(self) -> dict[str, Any] | None:
        """Return the fault that ended the run, None without one."""
        fault = self.trial.fault
        if fault is None:
            return None
        return fault | {"block": names.block_name(fault["culprit"]) if fault["culprit"] else ""}

    def events(self) -> Iterator[dict[str, Any]]:
        """Yield {"time": s, "kind", "text"} of the events that people read. A mark has the text of its note."""
        events = self.trial.events
        notes = {event["number"]: event["text"] for event in events if event.get("event") == "note"}
        for event in events:
            kind, tick = event.get("event"), event.get("tick")
            by = event.get("by", "")
            by = f" ({AUTHORS.get(by, by)})" if by else ""
            if kind == "mark":
                number = event["number"]
                text = f"Mark {number}: {notes[number]}" if number in notes else f"Mark {number}{by}"
            elif kind == "set":
                [name] = names.describe([{"path": event["path"], "unit": "any"}])
                block = f"{name['block']}: " if name["block"] else ""
                before = f"{event['from']:g} to " if "from" in event else "to "
                kind, text = "change", f"{block}{name['port']} {before}{event['value']:g}{by}"
            elif kind in STATES:
                text = f"{STATES[kind]}{by}"
            elif kind == "warning":
                text = f"{names.block_name(event['device'])}: {event['what']}"
            elif kind in ("fault", "end"):
                if event.get("status") == "ok":
                    text = "The run has ended"
                else:
                    kind = "fault"
                    culprit = event.get("culprit")
                    text = f"Fault{f' of {names.block_name(culprit)}' if culprit else ''}: {event['status']}"
            elif event.get("lines"):
                kind, text = "other", " ".join(map(str, event["lines"]))
            else:
                continue
            time = tick / self.trial.about["rate"] if isinstance(tick, (int, float)) and tick >= 0 else None
            yield {"time": time, "kind": kind, "text": text}
