"""What recorded signals become in a viewer: a plot a subsystem, limits, limbs with coloured joints, inertial sensors,
faults.

A limb model is found by its names: in one subsystem, actuators called `hip`, `knee` and `ankle` (or ending so, as in
`left_knee`) with a `position` in rad; what is not there stays straight. Angles are flexion: of the hip and of the ankle
forward, of the knee back.
"""

from dataclasses import dataclass, field

from runtime.recording.messages import split

JOINTS, SEGMENTS = ("hip", "knee", "ankle"), ("thigh", "shank", "foot")
# (Okabe and Ito 2008)
COLOURS = ((0, 114, 178), (213, 94, 0), (0, 158, 115), (204, 121, 167), (230, 159, 0), (86, 180, 233), (240, 228, 66))
PALE = 0.45  # of white, in the colour of a position beside its torque
SHOWN = ("position", "torque")  # ports of an actuator that a person wants to see together
MOST = 8  # lines that are shown where there is no actuator


@dataclass
class Plot:
    """
    title : of the subsystem
    entity : names from the outermost
    columns : places in the row; labels, shown, colours : of each
    limits : [(label, value)]
    """

    title: str
    entity: tuple
    columns: list = field(default_factory=list)
    labels: list = field(default_factory=list)
    shown: list = field(default_factory=list)
    colours: list = field(default_factory=list)
    limits: list = field(default_factory=list)

    def order(self):
        """What is shown comes first: a legend is as long as it finds room."""
        places = sorted(range(len(self.columns)), key=lambda place: not self.shown[place])
        self.columns, self.labels, self.shown = (
            [what[place] for place in places] for what in (self.columns, self.labels, self.shown)
        )

    def paint(self):
        """An actuator's torque and position in one hue, the position paler; each other signal in one of its own."""
        devices, self.colours = {}, []
        for number, (label, shown) in enumerate(zip(self.labels, self.shown)):
            block, _, port = label.partition(" [")[0].rpartition(".")
            if shown and port in SHOWN:
                hue = COLOURS[devices.setdefault(block, len(devices)) % len(COLOURS)]
                pale = PALE if port == "position" else 0.0
                self.colours.append(tuple(round(share + pale * (255 - share)) for share in hue))
            else:
                self.colours.append(COLOURS[number % len(COLOURS)])


@dataclass(frozen=True)
class Joint:
    """position, torque : places in the row, None where it is not recorded; limit : N·m, of what is full colour"""

    name: str
    position: int | None
    torque: int | None
    limit: float


@dataclass(frozen=True)
class Limb:
    """side : name of its subsystem; place : how many limbs stand before it; joints : {name: Joint}"""

    side: str
    place: int
    joints: dict


@dataclass(frozen=True)
class Sensor:
    """An inertial sensor. columns : of its quaternion, w first; side, segment : where it sits, "" where the names do
    not tell
    """

    path: str
    columns: tuple
    side: str
    segment: str


class Scene:
    """
    name : of the diagram
    signals : as the plan of a recording has them
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

    def find_plots(self):
        plots, limits = {}, {}
        for path, place in self.places.items():
            folder, block, port = split(path)
            title = folder or self.name  # where a subsystem is called as the diagram, both are in one
            plot = plots.setdefault(title, Plot(title, tuple(folder.split("/")) if folder else (self.name,)))
            unit = self.signals[place]["unit"]
            plot.columns.append(place)
            plot.labels.append(path.removeprefix(f"{folder}/") + (f" [{unit}]" if unit not in ("1", "any") else ""))
            plot.shown.append(
                port in SHOWN and all(f"{folder}/{block}.{other}".lstrip("/") in self.places for other in SHOWN)
            )
            if path in self.limits and plot.shown[-1]:
                low, high = self.limits[path]
                for end, value in (("≤", high), ("≥", low)):
                    limits.setdefault(folder, {}).setdefault((port, end, value, unit), []).append(block)
        for folder, plot in plots.items():
            plot.limits = [
                (f"{', '.join(blocks)}.{port} {end} {value:g} {unit}", value)
                # equal ones are one line
                for (port, end, value, unit), blocks in limits.get(folder, {}).items()
            ]
            if not any(plot.shown):
                plot.shown = [number < MOST for number in range(len(plot.columns))]
            plot.order()
            plot.paint()
        return sorted(plots.values(), key=lambda plot: not driven(plot))

    def limb_of(self, sensor):
        """The limb that a sensor sits on, None where the names do not tell."""
        return next((limb for limb in self.limbs if limb.side == sensor.side), None) if sensor.segment else None

    def find_limbs(self):
        found = {}
        for path, place in self.places.items():
            folder, block, port = split(path)
            joint = next((name for name in JOINTS if block == name or block.endswith(f"_{name}")), None)
            if joint is None or port != "position" or self.signals[place]["unit"] != "rad":
                continue
            torque = f"{path.removesuffix('position')}torque"
            low, high = self.limits.get(torque, (-10.0, 10.0))
            found.setdefault(folder or self.name, {})[joint] = Joint(
                joint, place, self.places.get(torque), max(abs(low), abs(high))
            )
        return [Limb(side, place, joints) for place, (side, joints) in enumerate(found.items())]

    def find_sensors(self):
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


def driven(plot):
    """Whether it shows an actuator: those plots stand first."""
    return any(label.partition(" [")[0].endswith(".torque") for label, shown in zip(plot.labels, plot.shown) if shown)
