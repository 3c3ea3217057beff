"""The scene of a viewer: one plot per subsystem and unit, limits, limbs with coloured joints, inertial sensors, faults.

Limbs are detected by name: actuators of one subsystem called `hip`, `knee` and `ankle` (or with such an ending, as in
`left_knee`) with a `position` in rad. Missing joints stay straight. Angles are flexion: of hip and ankle forward, of
the knee backward.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from runtime.record.storage.grouping import PLAIN
from runtime.record.storage.messages import split

JOINTS, SEGMENTS = ("hip", "knee", "ankle"), ("thigh", "shank", "foot")
# (Okabe and Ito 2008)
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233), (240, 228, 66))
SHOWN_PORTS = ("position", "torque")  # of an actuator
LINE_LIMIT = 8  # visible lines of a plot without an actuator


@dataclass
class Plot:
    """Plot of the signals of one subsystem and unit.

    title : title of the subsystem, and unit
    entity : names from the outermost
    columns : indices in the row
    labels, shown, colours : label, visibility and colour of each column
    limits : [(label, value)]
    """

    title: str
    entity: tuple
    columns: list = field(default_factory=list)
    labels: list = field(default_factory=list)
    shown: list = field(default_factory=list)
    colours: list = field(default_factory=list)
    limits: list = field(default_factory=list)

    def order(self) -> None:
        """Sort visible lines first, because a long legend is cut."""
        places = sorted(range(len(self.columns)), key=lambda place: not self.shown[place])
        self.columns, self.labels, self.shown = (
            [what[place] for place in places] for what in (self.columns, self.labels, self.shown)
        )

    def paint(self) -> None:
        """Give each line a hue, so that torque and position of an actuator have the same in their plots."""
        self.colours = [COLOURS[number % len(COLOURS)] for number in range(len(self.columns))]


@dataclass(frozen=True)
class Joint:
    """Joint of a limb.

    position, torque : indices in the row, None if not recorded
    limit : N·m, torque of full colour
    """

    name: str
    position: int | None
    torque: int | None
    limit: float


@dataclass(frozen=True)
class Limb:
    """Limb of a subsystem. side : name of the subsystem; place : index of the limb; joints : {name: Joint}"""

    side: str
    place: int
    joints: dict


@dataclass(frozen=True)
class Sensor:
    """Inertial sensor.

    columns : indices of its quaternion in the row, w first
    side, segment : its mounting by name, "" if unknown
    """

    path: str
    columns: tuple
    side: str
    segment: str


class Scene:
    """Scene of one diagram.

    name : name of the diagram
    signals : signals in the form of a recording's plan
    limits : {path: (lowest, highest)}
    """

    def __init__(self, name, signals, limits):
        self.name, self.signals = name, signals
        self.places = {signal["path"]: place for place, signal in enumerate(signals)}
        self.limits = limits
        self.plots = self.find_plots()
        self.limbs = self.find_limbs()
        self.sensors = self.find_sensors()
        self.faults = [place for path, place in self.places.items() if split(path)[2] == "fault"]

    def find_plots(self) -> list[Plot]:
        """Return the plots of the subsystems, one for each unit, those with actuators first."""
        plots, limits, driven = {}, {}, set()
        for path, place in self.places.items():
            folder, block, port = split(path)
            unit = self.signals[place]["unit"]
            unit = "" if unit in PLAIN else unit
            title = folder or self.name  # a subsystem with the diagram's name shares its plots
            entity = (*folder.split("/"),) if folder else (self.name,)
            made = Plot(
                title + f" [{unit}]" * bool(unit), (*entity, unit.replace("·", "-").replace("/", "_per_") or "values")
            )
            plot = plots.setdefault((title, unit), made)
            plot.columns.append(place)
            plot.labels.append(path.removeprefix(f"{folder}/"))
            plot.shown.append(
                port in SHOWN_PORTS
                and all(f"{folder}/{block}.{other}".lstrip("/") in self.places for other in SHOWN_PORTS)
            )
            if plot.shown[-1]:
                driven.add(title)
            if path in self.limits and plot.shown[-1]:
                low, high = self.limits[path]
                for end, value in (("≤", high), ("≥", low)):
                    limits.setdefault((title, unit), {}).setdefault((port, end, value), []).append(block)
        for key, plot in plots.items():
            plot.limits = [
                (f"{', '.join(blocks)}.{port} {end} {value:g} {key[1]}", value)
                # equal limits share one line
                for (port, end, value), blocks in limits.get(key, {}).items()
            ]
            if key[0] not in driven:
                plot.shown = [number < LINE_LIMIT for number in range(len(plot.columns))]
            plot.order()
            plot.paint()
        return [plots[key] for key in sorted(plots, key=lambda key: key[0] not in driven)]

    def limb_of(self, sensor: Sensor) -> Limb | None:
        """Return the limb of a sensor; None if unknown."""
        return next((limb for limb in self.limbs if limb.side == sensor.side), None) if sensor.segment else None

    def find_limbs(self) -> list[Limb]:
        """Return the limbs, detected by the names of their actuators."""
        limbs = {}
        for path, place in self.places.items():
            folder, block, port = split(path)
            joint = next((name for name in JOINTS if block == name or block.endswith(f"_{name}")), None)
            if joint is None or port != "position" or self.signals[place]["unit"] != "rad":
                continue
            torque = f"{path.removesuffix('position')}torque"
            low, high = self.limits.get(torque, (-10.0, 10.0))
            limbs.setdefault(folder or self.name, {})[joint] = Joint(
                joint, place, self.places.get(torque), max(abs(low), abs(high))
            )
        return [Limb(side, place, joints) for place, (side, joints) in enumerate(limbs.items())]

    def find_sensors(self) -> list[Sensor]:
        """Return the inertial sensors with a recorded quaternion."""
        sensors = []
        for path in self.places:
            if not path.endswith(".quaternion[0]"):
                continue
            path = path.removesuffix("[0]")
            columns = tuple(self.places.get(f"{path}[{number}]") for number in range(4))
            if None not in columns:
                folder, block, _ = split(path)
                sensors.append(Sensor(path, columns, folder, next((name for name in SEGMENTS if name in block), "")))
        return sensors
