"""The scene of a viewer: one plot per subsystem, limits, limbs with coloured joints, inertial sensors, faults.

Limbs are detected by name: actuators of one subsystem called `hip`, `knee` and `ankle` (or with such an ending, as in
`left_knee`) with a `position` in rad. Missing joints stay straight. Angles are flexion: of hip and ankle forward, of
the knee backward.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from runtime.record.storage.messages import split

JOINTS, SEGMENTS = ("hip", "knee", "ankle"), ("thigh", "shank", "foot")
# (Okabe and Ito 2008)
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233), (240, 228, 66))
POSITION_WHITE_SHARE = 0.45  # in the colour of a position beside its torque
SHOWN_PORTS = ("position", "torque")  # of an actuator
LINE_LIMIT = 8  # visible lines of a plot without an actuator


@dataclass
class Plot:
    """Plot of one subsystem.

    title : title of the subsystem
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
        """Give torque and position of an actuator one hue, the position paler, and other signals hues of their own."""
        devices, self.colours = {}, []
        for number, (label, shown) in enumerate(zip(self.labels, self.shown)):
            block, _, port = label.partition(" [")[0].rpartition(".")
            if shown and port in SHOWN_PORTS:
                hue = COLOURS[devices.setdefault(block, len(devices)) % len(COLOURS)]
                pale = POSITION_WHITE_SHARE if port == "position" else 0.0
                self.colours.append(tuple(round(share + pale * (255 - share)) for share in hue))
            else:
                self.colours.append(COLOURS[number % len(COLOURS)])


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
        """Return the plots of the subsystems, those with actuators first."""
        plots, limits = {}, {}
        for path, place in self.places.items():
            folder, block, port = split(path)
            title = folder or self.name  # a subsystem with the diagram's name shares its plot
            plot = plots.setdefault(title, Plot(title, tuple(folder.split("/")) if folder else (self.name,)))
            unit = self.signals[place]["unit"]
            plot.columns.append(place)
            plot.labels.append(path.removeprefix(f"{folder}/") + (f" [{unit}]" if unit not in ("1", "any") else ""))
            plot.shown.append(
                port in SHOWN_PORTS
                and all(f"{folder}/{block}.{other}".lstrip("/") in self.places for other in SHOWN_PORTS)
            )
            if path in self.limits and plot.shown[-1]:
                low, high = self.limits[path]
                for end, value in (("≤", high), ("≥", low)):
                    limits.setdefault(folder, {}).setdefault((port, end, value, unit), []).append(block)
        for folder, plot in plots.items():
            plot.limits = [
                (f"{', '.join(blocks)}.{port} {end} {value:g} {unit}", value)
                # equal limits share one line
                for (port, end, value, unit), blocks in limits.get(folder, {}).items()
            ]
            if not any(plot.shown):
                plot.shown = [number < LINE_LIMIT for number in range(len(plot.columns))]
            plot.order()
            plot.paint()
        return sorted(plots.values(), key=lambda plot: not is_driven(plot))

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


def is_driven(plot: Plot) -> bool:
    """Return whether a plot shows an actuator; these plots come first."""
    return any(label.partition(" [")[0].endswith(".torque") for label, shown in zip(plot.labels, plot.shown) if shown)
