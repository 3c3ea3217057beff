"""The pre-flight table: the first sample and the safe stop of every device.

The control process makes it as plain data between two rounds of arming. The recorder, which owns the terminal, prints
it (runtime.report.preflight), and the operator confirms it before a drive is enabled.
"""

from graph.signal import Signal
from runtime.report.failure_coverage import coverage

OLD_SAMPLE_AGE = 0.5  # share of the device's timeout
RANGE_END_MARGIN = 1e-3  # share of the position range


class Preflight:
    """The pre-flight table of a robot on its rig.

    diagram, schedule : of the robot, with the parameters of its rig
    interfaces : {bus: (interface, channel)}
    confirm : whether the operator confirms the table
    granted : texts, the real-time privileges of the guardian
    poses : runtime.rig.poses.Poses, or None
    """

    def __init__(self, diagram, schedule, interfaces, confirm, granted=(), poses=None):
        self.poses = poses
        self.schedule, self.confirm, self.granted = schedule, confirm, list(granted)
        self.devices = [diagram[device.name] for device in schedule.devices]
        self.buses = [self.bus(name, interfaces) for name in schedule.buses]

    def bus(self, name, interfaces):
        load = next((load for load in self.schedule.loads if load.bus == name), None)
        interface, channel = interfaces.get(name, (None, None))
        return {
            "bus": name,
            "interface": interface,
            "channel": channel,
            "typical": None if load is None else load.typical,
            "worst": None if load is None else load.worst,
            "coverage": coverage([block for block in self.devices if block.bus == name], self.devices),
        }

    def event(self, values):
        """Return the table as an event. values : the arena"""
        refusals = {} if self.poses is None else self.poses.look(values)
        rows = [self.row(block, values) for block in self.devices]
        for row in rows:
            if row["device"] in refusals:
                row["marks"].setdefault("position", "in doubt")
        return {
            "event": "preflight",
            "devices": rows,
            "buses": self.buses,
            "guardian": self.granted,
            "refused": list(refusals.values()),
            "confirm": self.confirm,
        }

    def row(self, block, values):
        def measured(name):
            place = self.schedule.signals.get(Signal(block, name).path) if name in block.outputs else None
            return None if place is None or place.size != 1 else float(values[place.slot])

        sample = {name: measured(name) for name in ("age", "position", "velocity", "temperature", "fault")}
        if sample["temperature"] is not None and sample["temperature"] != sample["temperature"]:
            sample["temperature"] = None  # NaN: the replies of this drive carry no temperature
        span = position_range(block)
        row = {
            "device": block.path,
            "bus": block.bus,
            "ids": block.displayed_addresses(),
            "answered": True,
            **sample,
            "low": span[0],
            "high": span[1],
            "fault_words": None if sample["fault"] is None else block.fault_in_words(int(sample["fault"])),
            "limit": getattr(block, "torque_limit", None),
            "own_timeout": block.own_timeout,
            "stop": stop_of(block),
        }
        return row | {"marks": marks(row, block)}


def position_range(block):
    """Return (low, high) of the position in rad: of the joint if its rig defines them; (None, None) without bounds."""
    if getattr(block, "range", ()):
        return tuple(block.range)
    if "position" not in block.outputs:
        return None, None
    try:
        span = block.output_range().get("position")
    except TypeError:  # the range depends on the inputs
        span = None
    if span is not None and abs(span.low) < 1e300 and abs(span.high) < 1e300:
        return span.low, span.high
    return None, None


def stop_of(block):
    """Return a description of a device's safe stop."""
    damped = block.damped_stop()
    if damped is not None:
        first = f"damped within {damped.limit:.3g} N·m for {damped.duration:g} s"
    else:
        first = "zero torque" if block.zero_frames() else ""
    return " then ".join([first] * bool(first) + ["disable"] * bool(block.disable_frames())) or "nothing to stop"


def marks(row, block):
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
