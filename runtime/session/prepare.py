"""First stage of a run: loading, compiling and checking."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from blocks.recorders import CsvRecorder
from blocks.safety import Rearm
from blocks.sinks import Panel, PlotJuggler, Rerun
from graph import Device, Diagram, Schedule
from graph.diagnostics import Diagnostic
from graph.solvers import INACCURATE
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.record.recorder import can_ask
from runtime.record.report.preflight.table import stopping_panel
from runtime.robot.loading.file import compile_diagram, load
from runtime.robot.loading.overrides import set_seeds
from runtime.robot.loading.simulation import Simulation
from runtime.session.request import Request

if TYPE_CHECKING:
    from pathlib import Path

    from cext.schedule.program import Program
    from runtime.robot.loading.subject import Subject
    from runtime.robot.rig.buses import RigBuses
    from runtime.robot.rig.poses import Poses
    from runtime.robot.rig.record_checks import Compared
    from runtime.session.replay_feed import Feed

NO_CONFIRMATION = (
    "on a rig the operator confirms the pre-flight table with Enter, but standard input, output and error are not a "
    "terminal: pass --yes to arm without confirmation"
)
NO_REQUEST = (
    "--rearm: nothing can request arming: standard input, output and error are not all a terminal for the key r, and "
    "the diagram has no Rearm block. Run in a terminal or add a Rearm block"
)
RATE_LIMIT = 100_000.0  # Hz; a shorter period is too short to sleep in


@dataclass
class Prepared:
    """A run that is ready to be armed, in simulation or on a rig.

    ticks : grid points, -1 until stopped
    poses : poses of the joints of a rig; they prevent arming if a joint may differ from its drive's reading
    arm_slot : slot of the arena of the signal of --arm-on, -1 without one
    source_sha256 : hex digest of the source of the diagram file; None without a file
    feed : clock and buses of a recorded run that is repeated; None for a new run
    subject : Subject whose limits the diagram and the schedule contain, or None
    compared : records of commissioning that were compared with the units; None without a subject file
    """

    request: Request
    diagram: Diagram
    schedule: Schedule
    simulation: Simulation | None
    rig: RigBuses | None
    ticks: int
    poses: Poses | None = field(default=None, kw_only=True)
    arm_slot: int = field(default=-1, kw_only=True)
    source_sha256: str | None = field(default=None, kw_only=True)
    feed: Feed | None = field(default=None, kw_only=True)
    subject: Subject | None = field(default=None, kw_only=True)
    compared: Compared | None = field(default=None, kw_only=True)

    @property
    def plant(self) -> Program | None:
        """The program of the plant, None on a rig."""
        return self.simulation.program if self.simulation is not None else None

    @property
    def warnings(self) -> list[Diagnostic]:
        """Warnings of the compile, and those of a plant that may be inaccurate."""
        plant = self.simulation.plant if self.simulation is not None else None
        own = () if plant is None else (each for each in plant.warnings if each.code == INACCURATE)
        return [*self.schedule.warnings, *own]

    @property
    def substeps(self) -> int:
        """Ticks of the plant in one tick of the robot."""
        return self.simulation.substeps if self.simulation is not None else 1

    @property
    def ramp(self) -> dict[str, Any]:
        """Options of the Executor that end the session of a subject with a ramp, {} without one."""
        return {} if self.subject is None else self.subject.ramp(self.schedule.rate)

    def subject_lines(self) -> list[str]:
        """Return lines on the limits of a subject and on the records of its robot, [] without one."""
        limits = [] if self.subject is None else self.subject.lines(self.diagram)
        return limits + ([] if self.compared is None else self.compared.lines)

    def ends(self) -> list[Any]:
        """Return the robot's end of each bus, in the order of the schedule."""
        buses = self.feed or self.simulation or self.rig
        assert buses is not None
        return buses.ends()


def prepare(request: Request) -> Prepared:
    """Load and compile the diagram of a Request. Returns a Prepared. Raises BadInput or DiagramError."""
    if request.rig is not None:
        return prepare_on_rig(request, request.rig)
    subject = read_subject(request)
    file, diagram = load(request.file, request.settings, subject=subject)
    schedule, ticks = compile_adapted(request, diagram, subject)
    simulation = Simulation(file, diagram, schedule, request.bitrate, request.seed)
    return Prepared(request, diagram, schedule, simulation, None, ticks, source_sha256=file.sha256, subject=subject)


def read_subject(request: Request) -> Subject | None:
    """Return the Subject of a Request, None without one. Raises BadInput."""
    if request.subject is None:
        return None
    from runtime.robot.loading.subject import read  # a run without one starts without it

    subject = read(request.subject)
    return subject.for_any_joint() if request.bench else subject


def prepare_on_rig(request: Request, path: Path) -> Prepared:
    """Prepare a run on a rig. Arguments, result and errors as for `prepare`. path : path of the rig file"""
    # a simulation starts without these
    from runtime.robot.rig.acceptance import require_acceptance
    from runtime.robot.rig.battery import require_supply
    from runtime.robot.rig.buses import RigBuses
    from runtime.robot.rig.file import read
    from runtime.robot.rig.joints import require_ranges
    from runtime.robot.rig.poses import Poses

    rig, subject = read(path), read_subject(request)
    file, diagram = load(request.file, request.settings, rig, subject=subject)
    if not request.bench:
        require_ranges(rig, diagram)
        require_supply(rig.battery, diagram, rig.path)
    schedule, ticks = compile_adapted(request, diagram, subject)
    unrecorded, compared = [], None
    if subject is not None and not request.bench:
        from runtime.robot.rig.record_checks import compare_records

        unrecorded, compared = compare_records(rig, diagram, subject.name, request.accept)
        if compared is not None:
            compared.require(diagram, schedule)
    require_acceptance(rig.path, [*schedule.caveats, *unrecorded], request.accept)
    if not request.yes and request.arm_on is None and not can_ask():
        raise BadInput(f"{NO_CONFIRMATION}, or --arm-on SIGNAL to arm with a button")
    poses = Poses(diagram, schedule, request.poses)
    return Prepared(
        request,
        diagram,
        schedule,
        None,
        RigBuses(rig, diagram, schedule.buses),
        ticks,
        poses=poses,
        arm_slot=arming_slot(diagram, schedule, request.arm_on),
        source_sha256=file.sha256,
        subject=subject,
        compared=compared,
    )


def compile_adapted(request: Request, diagram: Diagram, subject: Subject | None = None) -> tuple[Schedule, int]:
    """Apply the options of a Request to its diagram and compile it. Returns its Schedule and the number of ticks.

    subject : Subject, which may end the run earlier
    """
    adapt(diagram, request)
    stopping_panel(diagram)
    ticks = ticks_of(request, diagram, subject)
    schedule = compile_diagram(request.file, diagram)
    check_rearming(diagram, request.rearm, can_ask())
    return schedule, ticks


def arming_slot(diagram: Diagram, schedule: Schedule, signal: str | None) -> int:
    """Return the slot of the arena of the signal of --arm-on, -1 without one.

    Raises BadInput unless it is a bool output of a device, the only signals that are read before arming.
    """
    if signal is None:
        return -1
    allowed = [
        f"{block.path}.{name}"
        for block in diagram
        if isinstance(block, Device)
        for name, port in block.outputs.items()
        if (port.dtype, port.shape) == ("bool", ())
    ]
    if signal not in allowed:
        raise BadInput(
            f"--arm-on {signal}: expected a bool output of a device, such as the button of a GpioInput; "
            + (suggestion(signal, allowed) or f"the diagram has {', '.join(allowed) or 'none'}")
        )
    return schedule.signals[signal].slot


def check_rearming(diagram: Diagram, enabled: bool, keys: bool) -> None:
    """Raise BadInput if --rearm has no source of requests. keys : whether there is a terminal for the key r"""
    if enabled and not keys and not any(isinstance(block, Rearm) for block in diagram):
        raise BadInput(NO_REQUEST)


def ticks_of(request: Request, diagram: Diagram, subject: Subject | None = None) -> int:
    """Return the number of grid points of a run, of a Subject at most, -1 until stopped. Raises BadInput."""
    if diagram.rate > RATE_LIMIT:
        raise BadInput(f"rate {diagram.rate:g} Hz is above the limit of {RATE_LIMIT:g} Hz")
    ticks = -1 if request.duration is None else round(request.duration * diagram.rate)
    if ticks == 0:
        raise BadInput(f"--duration {request.duration:g}: shorter than one tick, which takes {1.0 / diagram.rate:g} s")
    return ticks if subject is None else subject.ticks(diagram.rate, ticks)


def adapt(diagram: Diagram, request: Request) -> None:
    """Apply the options that change the diagram, before it is compiled."""
    if request.rate is not None:
        diagram.rate = request.rate
    if request.seed is not None:
        set_seeds(diagram, request.seed)
    if request.plotjuggler is not None:
        host, port = request.plotjuggler
        viewers = [block for block in diagram if isinstance(block, PlotJuggler)]
        with diagram:
            for viewer in viewers or [PlotJuggler()]:
                viewer.host, viewer.port, viewer.virtual_time = host, port, True
    if request.rerun is not None:
        viewers = [block for block in diagram if isinstance(block, Rerun)]
        with diagram:
            for viewer in viewers or [Rerun()]:
                viewer.target = request.rerun
    if request.panel is not None:
        panels = [block for block in diagram if isinstance(block, Panel)]
        with diagram:
            for panel in panels or [Panel()]:
                panel.host, panel.port = request.panel
    if request.panel_lost is not None:
        panels = [block for block in diagram if isinstance(block, Panel)]
        if not panels:
            raise BadInput(f"--panel-lost {request.panel_lost}: the run has no page: add --panel")
        for panel in panels:
            panel.lost = "stop" if request.panel_lost == "stop" else "continue"
    if request.record is not None and not any(isinstance(block, CsvRecorder) for block in diagram):
        with diagram:
            CsvRecorder()
