"""Failures of a run on a rig that still end in the safe stop of a bus, and the component that performs it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from graph.device import Device
    from runtime.host.console.styles import Console

GUARDIAN, WATCHDOG, RUN, DRIVES = (
    "the guardian",
    "the watchdog, then the guardian",
    "the run itself",
    "the drives' own time-out",
)
DECLARED = "the drives' own time-out, which is declared and not read back"


def coverage(
    devices: Sequence[Device], everything: Sequence[Device], page: bool = False
) -> list[dict[str, bool | str]]:
    """Return the failures of a run, as a list of {"failure", "covered", "by"}.

    The list is empty for a bus without anything to stop. `by` names the component that stops the drives, or the drives
    that nothing stops.

    devices : graph.Device on the bus
    everything : graph.Device of the whole diagram
    page : whether a lost page of the panel is a stop
    """
    movers = [device for device in devices if _moves(device)]
    if not movers:
        return []
    alone = drives_left_commanded(movers, everything)
    last = " and ".join(dict.fromkeys(words for device in movers for words in stops(device, everything)))
    by = last if not alone else f"{nothing_stops(alone)}: no time-out in the drive, no charge pump"
    return [
        _entry("exception", RUN),
        _entry("kill -9", GUARDIAN),
        _entry("kill -STOP", GUARDIAN),
        _entry("hung block", WATCHDOG),
        _entry("loss of the guardian", RUN),
        *[_entry("loss of the page with the controls", RUN)] * page,
        _entry("kill -9 of guardian and control process together", by, covered=not alone),
        _entry("power loss of the computer", by, covered=not alone),
        _entry("suspend of the computer", by, covered=not alone),
    ]


def _moves(device: Device) -> bool:
    return bool(device.disable_frames() or device.zero_frames())


def stops(device: Device, everything: Sequence[Device]) -> list[str]:
    """Return the mechanisms that stop a drive without the control process and the guardian.

    They are the drive's own time-out, or the charge pumps that hold its power.
    """
    own = [DECLARED if device.own_timeout_declared else DRIVES] if device.own_timeout is not None else []
    return own or [f"the charge pump {other.path!r}" for other in everything if other.holds_power_of(device)]


def drives_left_commanded(devices: Sequence[Device], everything: Sequence[Device]) -> list[str]:
    """Return the paths of the drives that keep their last command after both processes have ended."""
    return [device.path for device in devices if _moves(device) and not stops(device, everything)]


def nothing_stops(paths: Sequence[str]) -> str:
    """Return the sentence on drives that keep their last command. paths : as returned by `unstopped`"""
    return f"nothing stops {', '.join(paths)} after both processes have ended"


def _entry(failure: str, by: str, covered: bool = True) -> dict[str, bool | str]:
    return {"failure": failure, "covered": covered, "by": by}


def in_words(coverage: Sequence[dict[str, bool | str]]) -> tuple[str, str]:
    """Return (covered, not covered) as texts, '' for none. coverage : list that coverage() returns"""
    by = {}
    for each in coverage:
        by.setdefault((each["covered"], each["by"]), []).append(each["failure"])
    texts = {
        covered: "; ".join(
            f"{', '.join(failures)} ({component})" for (is_so, component), failures in by.items() if is_so == covered
        )
        for covered in (True, False)
    }
    return texts[True], texts[False]


def coverage_lines(coverage: Sequence[dict[str, bool | str]], console: Console, margin: str) -> list[str]:
    """Return two lines: the failures that a bus covers, and those that it does not."""
    yes, no = in_words(coverage)
    lines = console.hang(f"{margin}covered: ", yes, console.faint) if yes else []
    return lines + (console.hang(f"{margin}not covered: ", no, console.warn) if no else [])
