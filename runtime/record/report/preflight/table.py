"""The pre-flight table: the first sample and the safe stop of every device.

The control process makes it as plain data between two rounds of arming. The recorder, which owns the terminal, prints
it (runtime.record.report.preflight.text), and the operator confirms it before a drive is enabled.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blocks.sinks import Panel
from graph import Actuator
from graph.caveats import in_words
from graph.device import actuators_of
from graph.signal import Signal
from runtime.host.errors import BadInput
from runtime.record.report.failure_coverage import coverage

if TYPE_CHECKING:
    import numpy as np

    from graph import Device, Diagram, Schedule
    from runtime.robot.rig.poses import Poses

OLD_SAMPLE_AGE = 0.5  # share of the device's timeout
NOT_SET = (None, (), "")  # values of a parameter that a diagram leaves to the rig
NO_PAGE = "no page has the controls: open the address of the panel in a browser, or take the controls there"
RANGE_END_MARGIN = 1e-3  # share of the position range


def stopping_panel(diagram: Diagram) -> Panel | None:
    """Return the Panel of a diagram whose lost page is a stop, or None. Raises BadInput for more than one."""
    panels = [block for block in diagram if isinstance(block, Panel) and block.lost == "stop"]
    if len(panels) > 1:
        names = " and ".join(panel.path for panel in panels)
        raise BadInput(f'{names} have lost="stop", but the controls of a run are on one page: keep it in one of them')
    return panels[0] if panels else None


class Preflight:
    """The pre-flight table of a robot on its rig.

    diagram, schedule : diagram and schedule of the robot, with the parameters of its rig
    interfaces : {bus: (interface, channel)}
    confirm : whether the operator confirms the table; or the signal that confirms it, as in --arm-on
    granted : texts, the real-time privileges of the guardian
    poses : runtime.robot.rig.poses.Poses, or None
    subject : lines on the limits of a subject file
    """

    def __init__(
        self,
        diagram: Diagram,
        schedule: Schedule,
        interfaces: Mapping[str, tuple[str, str]],
        confirm: bool | str,
        granted: Sequence[str] = (),
        poses: Poses | None = None,
        subject: Sequence[str] = (),
    ) -> None:
        self.poses, self.subject = poses, list(subject)
        self.page = stopping_panel(diagram) is not None
        self.schedule, self.confirm, self.granted = schedule, confirm, list(granted)
        self.devices = [diagram[device.name] for device in schedule.devices]
        self.buses = [self.bus(name, interfaces) for name in schedule.buses]
        self.unheard = [block.path for block in actuators_of(self.devices) if not block.ask_frames()]

    def bus(self, name: str, interfaces: Mapping[str, tuple[str, str]]) -> dict[str, Any]:
        """Return the row of a bus: its interface, load (share of the bitrate) and covered failures."""
        load = next((load for load in self.schedule.loads if load.bus == name), None)
        interface, channel = interfaces.get(name, (None, None))
        return {
            "bus": name,
            "interface": interface,
            "channel": channel,
            "typical": None if load is None else load.typical,
            "worst": None if load is None else load.worst,
            "coverage": coverage([block for block in self.devices if block.bus == name], self.devices, self.page),
        }

    def event(self, values: np.ndarray, found_enabled: Sequence[str] = (), linked: bool = False) -> dict[str, Any]:
        """Return the table as an event.

        values : the arena
        found_enabled : paths of the drives that another program has left enabled
        linked : whether a page of the panel has the controls
        """
        refusals = {} if self.poses is None else self.poses.look(values, unheard=self.unheard)
        rows = [self.row(block, values) for block in self.devices]
        for row in rows:
            row["found_enabled"] = row["device"] in found_enabled
            if row["device"] in refusals:
                row["marks"].setdefault("position", "in doubt")
        return {
            "event": "preflight",
            "devices": rows,
            "buses": self.buses,
            "guardian": self.granted,
            "refused": [*refusals.values(), *[NO_PAGE] * (self.page and not linked)],
            "confirm": self.confirm,
            "page": self.page,
            "subject": self.subject,
        }

    def row(self, block: Any, values: np.ndarray) -> dict[str, Any]:
        """Return the row of a device: its first sample in SI units, its limits, its safe stop and `marks`.

        values : the arena
        """

        def value_of(name):
            place = self.schedule.signals.get(Signal(block, name).path) if name in block.outputs else None
            return None if place is None or place.size != 1 else float(values[place.slot])

        heard = block.path not in self.unheard
        sample = {
            name: value_of(name) if heard else None for name in ("age", "position", "velocity", "temperature", "fault")
        }
        if sample["temperature"] is not None and sample["temperature"] != sample["temperature"]:
            sample["temperature"] = None  # NaN: the replies of this drive carry no temperature
        span = position_range(block)
        bound = self.schedule.torque_bounds.get(block.path)
        limit = getattr(block, "torque_limit", None)
        if bound is not None and (bound.limit is not None or bound.kind == "none"):
            limit = bound.limit
        row = {
            "device": block.path,
            "bus": block.bus,
            "ids": block.displayed_addresses(),
            "answered": heard,
            "enabling": enabling_of(block),
            "read_back": read_back_of(block),
            "taken_out": value_of("active") == 0.0,
            **sample,
            "low": span[0],
            "high": span[1],
            "fault_words": None if sample["fault"] is None else block.fault_in_words(int(sample["fault"])),
            "limit": limit,
            "limit_words": bound.limit_in_words() if bound is not None else "",
            "settings": settings_in_words(block),
            "own_timeout": block.own_timeout,
            "own_timeout_declared": block.own_timeout_declared,
            "stop": stop_of(block),
        }
        caveats = [caveat.words for caveat in self.schedule.caveats if caveat.path == block.path]
        return row | {"marks": marks(row, block) | ({"limit": "; ".join(caveats)} if caveats else {})}


def enabling_of(block: Device) -> str:
    """Return a text on an actuator that differs from others in how it is enabled, else ""."""
    if not isinstance(block, Actuator):
        return ""
    if not block.ask_frames():
        return "reports its state only once it is enabled"
    return "" if block.enable_frames() else "no separate enabling: it obeys commands from power-up"


def read_back_of(block: Device) -> str:
    """Return a text on the settings of an actuator that arming reads back."""
    if not isinstance(block, Actuator):
        return ""
    count = block.settings_read()
    words = [f"{count} settings read back"] * bool(count)
    words += [block.compared_in_words()] * bool(block.compared_in_words())
    words += [f"not read back: {', '.join(block.unread_settings)}"] * bool(block.unread_settings)
    return "; ".join(words) or "settings not read back"


def position_range(block: Device) -> tuple[float | None, float | None]:
    """Return (low, high) of the position in rad: of the joint if its rig defines them; (None, None) without bounds."""
    if joint := getattr(block, "range", ()):
        return tuple(joint)
    if "position" not in block.outputs:
        return None, None
    try:
        span = block.output_range().get("position")
    except TypeError:  # the range depends on the inputs
        span = None
    if span is not None and abs(span.low) < 1e300 and abs(span.high) < 1e300:
        return span.low, span.high
    return None, None


def settings_in_words(block: Device) -> list[str]:
    """Return texts on settings without a caveat that differ from the diagram, or from the table of the model."""
    deviations = block.deviations() if isinstance(block, Actuator) else ()
    known, changed = [deviation.parameter for deviation in deviations], {}
    for name, (source, before) in block.set_from.items():
        value = getattr(block, name)
        if name in block.hardware and name not in known and value != before and before not in NOT_SET:
            changed.setdefault(Path(source).name, []).append(f"{name} {plain(value)} (diagram {plain(before)})")
    found = [f"from {source}: {', '.join(texts)}" for source, texts in changed.items()]
    return found + [in_words(block, deviation) for deviation in deviations if deviation.safe]


def plain(value: Any) -> str:
    """Return the value of a parameter as text."""
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(value, float) else str(value)


def stop_of(block: Device) -> str:
    """Return a description of a device's safe stop."""
    damped = block.damped_stop()
    if damped is not None:
        first = f"damped within {damped.limit:.3g} N·m for {damped.duration:g} s"
    else:
        first = "zero torque" if block.zero_frames() else ""
    return " then ".join([first] * bool(first) + ["disable"] * bool(block.disable_frames())) or "nothing to stop"


def marks(row: Mapping[str, Any], block: Device) -> dict[str, str]:
    """Return the abnormal values of a row: {key of the row: reason}."""
    reasons = {}
    position, low, high = row["position"], row["low"], row["high"]
    if position is not None and low is not None:
        margin = RANGE_END_MARGIN * (high - low)
        if not low + margin < position < high - margin:  # also true for NaN
            reasons["position"] = "at the end of its range" if low <= position <= high else "outside its range"
    if row["temperature"] is not None and block.hot is not None and not row["temperature"] < block.hot:
        reasons["temperature"] = "hot"
    if row["fault"]:
        reasons["fault"] = row["fault_words"]
    if row["age"] is not None and block.timeout > 0.0 and not row["age"] <= OLD_SAMPLE_AGE * block.timeout:
        reasons["age"] = "old sample"
    return reasons
