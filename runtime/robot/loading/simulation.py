"""Simulation of a robot without a rig: a plant on in-memory buses."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING

from msgspec.structs import replace

from cext.bus.memory_bus import MemoryBus
from cext.bus.timed_bus import TimedBus
from cext.schedule.program import Program
from graph import Actuator, Device, Diagram, subsystem
from runtime.host.errors import BadInput
from runtime.robot.loading.file import build_plant, compile_diagram
from runtime.robot.loading.overrides import set_seeds
from runtime.robot.loading.recorded_signals import recorded_of_plant

if TYPE_CHECKING:
    from cext.bus.memory_bus import BusEnd
    from graph.schedule import Column, Schedule
    from runtime.robot.loading.diagram_file import DiagramFile
    from runtime.robot.loading.overrides import Replaced


class Simulation:
    """Compiled plant of a robot, and the buses between them.

    file : DiagramFile or None; without a `plant` in it, every device is emulated, each actuator on a free inertia
    robot : Diagram
    schedule : the robot's Schedule
    bitrate : bit/s of each bus; None: frames take no time
    seed : integer from which the seeds of the plant's noise sources are derived, or None to keep theirs
    plant_signals : signals or blocks of the plant whose values follow those of the robot in the rows of a run

    replaced : [(block, "seed", value before)] of those noise sources
    plant : the plant's Schedule, None for a robot without devices
    program : the plant's Program, None for a robot without devices
    """

    def __init__(
        self,
        file: DiagramFile | None,
        robot: Diagram,
        schedule: Schedule,
        bitrate: float | None = None,
        seed: int | None = None,
        plant_signals: str = "",
    ) -> None:
        self.given = file is not None and file.has_plant
        self.diagram, self.plant, self.replaced = plant_of(file, robot, seed)
        self.substeps = substeps(robot, self.diagram) if self.diagram is not None else 1
        fast = {load.bus: max(load.data_bitrate, bitrate or 0.0) for load in schedule.loads if load.data_bitrate}
        self.buses = {
            name: MemoryBus() if bitrate is None or medium != "can" else TimedBus(bitrate, fast.get(name, 0.0))
            for name, medium in zip(schedule.buses, schedule.media)
        }
        self.program = None
        if self.plant is not None:
            self.plant = plant = replace(
                self.plant, **recorded_of_plant(self.plant, plant_signals, len(schedule.columns))
            )
            unknown = [name for name in plant.buses if name not in self.buses]
            if unknown:
                known = ", ".join(self.buses) or "none"
                raise BadInput(f"the plant emulates a device on bus {unknown[0]!r}, but the robot's buses are {known}")
            self.program = Program(plant, [self.buses[name].device for name in plant.buses])
        elif plant_signals:
            raise BadInput(f"{robot.name} has no plant, whose signals {plant_signals!r} could be recorded")

    @property
    def recorded(self) -> Sequence[Column]:
        """Signals of the plant that follow those of the robot in the rows of a run."""
        return self.plant.recorded if self.plant is not None else ()

    def implausible(self) -> str | None:
        """Return the first limit of its wearer that the run exceeded, as text; None without one.

        A wearer is a block of the plant with the outputs plausible, limit and plausible_time, and the texts `limits`.
        """
        if self.program is None or self.plant is None or self.diagram is None:
            return None
        for block in self.diagram:
            if "plausible" in block.outputs:
                plausible, limit, time = (
                    self.program.values[self.plant.signals[f"{block.path}.{name}"].slot]
                    for name in ("plausible", "limit", "plausible_time")
                )
                if not plausible:
                    return f"{block.path}: {block.limits[int(limit)]} after {time:.3g} s"
        return None

    def ends(self) -> list[BusEnd]:
        """Return the robot's end of each bus, in the schedule's order."""
        return [bus.host for bus in self.buses.values()]


def plant_of(
    file: DiagramFile | None, robot: Diagram, seed: int | None = None
) -> tuple[Diagram | None, Schedule | None, list[Replaced]]:
    """Build and compile the plant of a robot. file, seed : as in Simulation

    Returns (Diagram, Schedule, replaced seeds); (None, None, []) for a robot without devices.
    """
    given = file if file is not None and file.has_plant else None
    diagram = build_plant(given, robot) if given else default_plant(robot)
    if diagram is None:
        return None, None, []
    replaced = [] if seed is None else set_seeds(diagram, seed)
    return diagram, compile_diagram(given.path if given else robot.name, diagram), replaced


def substeps(robot: Diagram, plant: Diagram) -> int:
    """Return the number of ticks of the plant in one tick of the robot.

    Raises BadInput if the plant's rate is not a whole multiple of the robot's.
    """
    ratio = plant.rate / robot.rate
    if ratio < 1 or abs(ratio - round(ratio)) > 1e-9:
        raise BadInput(
            f"the plant runs at {plant.rate:g} Hz, which is not a whole multiple of the robot's {robot.rate:g} Hz: "
            f"set a multiple, such as rate=5 * robot.rate"
        )
    return round(ratio)


def default_plant(robot: Diagram) -> Diagram | None:
    """Return a plant that emulates every device, each actuator on a free inertia; None for a robot without devices."""
    devices = [block for block in robot if isinstance(block, Device)]
    if not devices:
        return None
    from blocks.models import Limb

    with Diagram(f"{robot.name}_plant", rate=5 * robot.rate) as plant:
        for device in devices:
            with ExitStack() as inside:
                for name in device.path.split("/"):
                    inside.enter_context(subsystem(name))
                emulated = device.emulator()
                if isinstance(device, Actuator):
                    limb = Limb(inertia=0.1, damping=0.1, stiffness=0.0, reflex=0.0)
                    limb(torque=emulated.torque)
                    emulated(position=limb.position, velocity=limb.velocity)
    return plant
