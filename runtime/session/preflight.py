"""The pre-flight table: what every device has answered, and what would stop it, for a person to read before anything
may move.

It is made in the control process as plain data, between two rounds of arming, and told by the recorder, which has the
terminal (runtime.report.preflight).
"""

from graph.signal import Signal
from runtime.report.failure_coverage import coverage

OLD = 0.5  # share of its timeout beyond which a sample is old
NEAR = 1e-3  # share of its range within which a position counts as at its end


class Preflight:
    """
    diagram, schedule : of the robot, as its rig has it
    interfaces : {bus: (interface, channel)}
    confirm : whether somebody is asked
    granted : what the system has granted the guardian, in words
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
        """What there is to tell. values : the arena"""
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

        found = {name: measured(name) for name in ("age", "position", "velocity", "temperature", "fault")}
        if found["temperature"] is not None and found["temperature"] != found["temperature"]:
            found["temperature"] = None  # replies of this drive carry none
        span = position_range(block)
        row = {
            "device": block.path,
            "bus": block.bus,
            "ids": block.told_addresses(),
            "answered": True,
            **found,
            "low": span[0],
            "high": span[1],
            "fault_words": None if found["fault"] is None else block.fault_in_words(int(found["fault"])),
            "limit": getattr(block, "torque_limit", None),
            "own_timeout": block.own_timeout,
            "stop": stop_of(block),
        }
        return row | {"marks": marks(row, block)}


def position_range(block):
    """(low, high) of the position in rad, the joint's own where its rig says it; None where nothing bounds it."""
    if getattr(block, "range", ()):
        return tuple(block.range)
    if "position" not in block.outputs:
        return None, None
    try:
        span = block.output_range().get("position")
    except TypeError:  # it wants to know its inputs
        span = None
    finite = span is not None and abs(span.low) < 1e300 and abs(span.high) < 1e300
    return (span.low, span.high) if finite else (None, None)


def stop_of(block):
    """How its safe stop is done, in words."""
    damped = block.damped_stop()
    if damped is not None:
        first = f"damped within {damped.limit:.3g} N·m for {damped.duration:g} s"
    else:
        first = "zero torque" if block.zero_frames() else ""
    return " then ".join([first] * bool(first) + ["disable"] * bool(block.disable_frames())) or "nothing to stop"


def marks(row, block):
    """What of a row is out of the ordinary: {key of the row: why}."""
    found = {}
    position, low, high = row["position"], row["low"], row["high"]
    if position is not None and low is not None:
        margin = NEAR * (high - low)
        if not low + margin < position < high - margin:  # NaN is out of the ordinary, too
            found["position"] = "at the end of its range" if low <= position <= high else "outside its range"
    if row["temperature"] is not None and block.hot is not None and not row["temperature"] < block.hot:
        found["temperature"] = "hot"
    if row["fault"]:
        found["fault"] = row["fault_words"]
    if row["age"] is not None and block.timeout > 0.0 and not row["age"] <= OLD * block.timeout:
        found["age"] = "an old sample"
    return found
