"""One run: a diagram file becomes a schedule, meets its plant, is armed, runs, stops, and is told about."""

import json
import signal
import time
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property

from cext.safety.shared_state import RECORD_EVENT, Page
from cext.safety.thresholds import GUARDIAN_LOOK_LIMIT, GUARDIAN_SILENCE
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.base.ending import ENDING_SIGNALS
from runtime.base.errors import BadInput
from runtime.diagrams.file import compiled, load
from runtime.diagrams.overrides import set_seeds
from runtime.diagrams.simulation import Simulation
from runtime.live.table import describe
from runtime.machine.realtime import PRIORITY, Realtime
from runtime.recorder import RecorderProcess, can_ask
from runtime.report.fault import explain
from runtime.report.held_exceptions import held
from runtime.rig import RigBuses, read, require_ranges
from runtime.rig.poses import Poses
from runtime.session import rearming
from runtime.session.preflight import Preflight
from runtime.session.rearming import Rearming
from runtime.session.recording_plan import plan, ring_bytes
from runtime.session.request import Request

NOBODY = (
    "on a rig somebody reads the pre-flight table and presses Enter, and here is no terminal for that (standard "
    "input, output and error); "
    "--yes arms without asking"
)
RATE_LIMIT = 100_000.0  # Hz; a shorter period is too short to sleep in


@dataclass
class Prepared:
    """A run that only has to be armed, in simulation or on a rig.

    ticks : grid points, -1 until stopped
    poses : of a rig, which refuse to arm
    source_sha256 : hex digest of the source of the diagram file; None where there is no file
    """

    request: Request
    diagram: object
    schedule: object
    simulation: Simulation | None
    rig: RigBuses | None
    ticks: int
    poses: Poses | None = field(default=None, kw_only=True)
    source_sha256: str | None = field(default=None, kw_only=True)

    @property
    def plant(self):
        """Program of the plant, None on a rig."""
        return self.simulation.program if self.simulation is not None else None


@dataclass
class Result(Prepared):
    """What became of a run.

    outcome : cext.schedule.executor.Outcome
    statistics : of the page
    recording : the recorder's report
    seconds : of the wall clock, from arming to the end of the safe stop
    control : the robot's Program, as the run has left it
    realtime : what the system granted
    overruns : who took the time where grid points were missed, as cext.schedule.executor.Executor.overruns has it
    profile : (rows of the robot, rows of its plant), likewise
    page : the shared page, with all that was counted
    newest : rows of the last ticks, as cext.schedule.executor.Executor.newest has them
    report : lines about the fault that it ended with
    """

    outcome: object
    statistics: dict
    recording: dict
    seconds: float
    control: Program
    realtime: Realtime
    overruns: list
    profile: tuple
    page: Page
    newest: list
    report: list = field(default_factory=list)

    @cached_property
    def held(self):
        """Exceptions that were no fault, as runtime.report.held_exceptions.held has them."""
        return held(self.request.file, self.control, self.plant)

    @property
    def failed_in_plant(self):
        outcome = self.outcome
        there = self.simulation is not None and outcome.faulted and outcome.status != "overrun"
        return there and self.control.culprit is None and outcome.culprit is not None


def prepare(request):
    """Everything that can be found wrong before a run. Returns a Prepared; raises BadInput or DiagramError."""
    rig = read(request.rig) if request.rig is not None else None
    file, diagram = load(request.file, request.settings, rig)
    if rig is not None and not request.bench:
        require_ranges(rig, diagram)
    adapt(diagram, request)
    ticks = ticks_of(request, diagram)
    schedule = compiled(request.file, diagram)
    rearming.check(diagram, request.rearm, can_ask())
    if rig is not None:
        if not request.yes and not can_ask():
            raise BadInput(NOBODY)
        poses = Poses(diagram, schedule, request.poses)
        return Prepared(
            request,
            diagram,
            schedule,
            None,
            RigBuses(rig, diagram, schedule.buses),
            ticks,
            poses=poses,
            source_sha256=file.sha256,
        )
    return Prepared(
        request,
        diagram,
        schedule,
        Simulation(file, diagram, schedule, request.bitrate, request.seed),
        None,
        ticks,
        source_sha256=file.sha256,
    )


def ticks_of(request, diagram):
    """Number of grid points that a run has, -1 until stopped. Raises BadInput."""
    if diagram.rate > RATE_LIMIT:
        raise BadInput(f"{diagram.rate:g} Hz is too fast: {RATE_LIMIT:g} Hz at most")
    ticks = -1 if request.duration is None else round(request.duration * diagram.rate)
    if ticks == 0:
        raise BadInput(f"--duration {request.duration:g}: shorter than one tick, which takes {1.0 / diagram.rate:g} s")
    return ticks


def run(prepared, say=lambda lines: None, count_from=0):
    """Carry out what `prepare` returned. Returns a Result; raises RecorderError or RealtimeRefused before anything is
    armed.

    say : called with the lines that a person should read before the run
    count_from : tick from which on answers that are missing are counted
    """
    request, schedule, simulation, rig = prepared.request, prepared.schedule, prepared.simulation, prepared.rig
    page = Page(ring_bytes(schedule), live=describe(schedule))
    if rig is not None:
        guard(rig, page, prepared)
    recorder = RecorderProcess(page)  # before the priority, the lock and the processor that are not for it
    realtime = Realtime(request.realtime, request.priority or PRIORITY, request.cpu)
    try:
        realtime.obtain()
        aside = realtime.others if realtime.processor is not None else ()
        if realtime.others and not request.fast:
            recorder.keep_to(realtime.others)
        if aside and rig is not None:
            rig.guardian.bring_to(aside)
        say(
            [
                *(rig.remarks() if rig is not None else []),
                *realtime.lines(),
                *(realtime.risk() if rig is not None else []),
            ]
        )
        recorder.configure(plan(prepared, realtime))
        control = Program(schedule, (simulation if rig is None else rig).ends())
        control.count_from(count_from)
        again = Rearming(prepared, page, control, can_ask())
        executor = Executor(
            control,
            schedule.rate,
            plant=prepared.plant,
            substeps=simulation.substeps if rig is None else 1,
            page=page,
            virtual=request.fast,
            reader=recorder.lifeline,
            overrun=request.overrun,
            spin=request.spin,
            profile=request.profile,
            guard=GUARDIAN_SILENCE * 1e-9 if rig is not None else 0.0,
            carried=rig is not None and rig.carries,
            others=aside,
        )
    except BaseException:
        realtime.release()
        recorder.abandon()
        if rig is not None:
            rig.close()
        raise
    again.executor = executor
    outcome = result = None
    began = time.monotonic()
    handler = hear_one_interrupt(page)
    try:
        outcome = executor.run(prepared.ticks, **asked(prepared, page, control), **again.options())
    finally:
        with undisturbed(handler):
            seconds = time.monotonic() - began
            if rig is not None and outcome is not None:
                outcome = stopped_by_hand(outcome, rig, page)
            realtime.release()
            if realtime.spun:
                tell(
                    page,
                    json.dumps({"event": "realtime", "lost": "the priority", "because": realtime.summary()}).encode(),
                    recorder,
                )
            statistics = page.statistics()
            if rig is not None:
                tell(page, json.dumps({"event": "buses", **rig.finish()}).encode(), recorder)
                if rig.report["stop"] is not None:
                    tell(page, json.dumps(rig.report["stop"]).encode(), recorder)
                statistics["frames"] = rig.correct(statistics["frames"])
            if outcome is not None:
                result = Result(
                    **vars(prepared),
                    outcome=outcome,
                    statistics=statistics,
                    recording={},
                    seconds=seconds,
                    control=control,
                    realtime=realtime,
                    overruns=executor.overruns,
                    profile=executor.profile,
                    page=page,
                    newest=executor.newest,
                )
                if outcome.faulted:
                    result.report += again.told(outcome) or explain(result)
                tell(page, json.dumps(end_event(result)).encode(), recorder)
            page.close()
            recording = recorder.finish()
    result.recording.update(recording)
    return result


def asked(prepared, page, control):
    """Options of Executor.run: on a rig the pre-flight table is told before anything may move, and somebody has to
    press Enter.
    """
    rig = prepared.rig
    if rig is None:
        return {}
    interfaces = {name: (bus.interface.bus.interface, bus.interface.bus.channel) for name, bus in rig.buses.items()}
    table = Preflight(
        prepared.diagram, prepared.schedule, interfaces, not prepared.request.yes, rig.guardian.granted, prepared.poses
    )

    def show():
        page.push(RECORD_EVENT, json.dumps(table.event(control.values)).encode())

    def permitted():
        """Whether every joint stands where its drive reads. To an operator who has confirmed where one does not, the
        table is shown as it is now.
        """
        if prepared.poses is None or not prepared.poses.look(control.values):
            return True
        if page.state == "ready":
            show()
        return False

    return {"answered": show, "confirm": table.confirm, "permitted": permitted}


def stopped_by_hand(outcome, rig, page):
    """The Outcome, once the actuators have been stopped from here where the guardian that carries their frames no
    longer answers.
    """
    if outcome.status != "unguarded" and not (outcome.unconfirmed and rig.carries and not looks(page)):
        return outcome
    if outcome.status in ("silent", "no answer", "bus error"):  # its drives are silent because it is
        outcome = replace(outcome, status="unguarded", culprit=None)
    return replace(outcome, unconfirmed=rig.take_over())


def looks(page):
    """Whether the guardian looks at the page once more within a moment."""
    before, deadline = page.guarded, time.monotonic() + GUARDIAN_LOOK_LIMIT * 1e-9
    while page.guarded == before and time.monotonic() < deadline:
        time.sleep(0.001)
    return page.guarded != before


def guard(rig, page, prepared):
    """The guardian comes first: without it nothing is armed. RigError"""
    priority = None if prepared.request.realtime == "off" else prepared.request.priority or PRIORITY
    try:
        rig.watch(page, prepared.schedule, prepared.diagram, priority)
    except BaseException:
        rig.close()
        raise


def hear_one_interrupt(page):
    """From now on a Ctrl-C does nothing once the motors are being stopped: the second finds Python's handler. Returns
    that of before.
    """

    def interrupt(number, frame):
        if page.state not in ("stopping", "safe"):
            raise KeyboardInterrupt

    return signal.signal(signal.SIGINT, interrupt)


@contextmanager
def undisturbed(before):
    """Ignore the ending signals: a second one tears neither the stop of the motors nor the end of a recording.

    before : the handler of SIGINT that is there afterwards
    """
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in ENDING_SIGNALS} | {signal.SIGINT: before}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


def adapt(diagram, request):
    """Options that change the diagram before it is compiled."""
    if request.rate is not None:
        diagram.rate = request.rate
    if request.seed is not None:
        set_seeds(diagram, request.seed)
    from blocks.recorders import CsvRecorder
    from blocks.sinks import PlotJuggler, Rerun

    if request.plotjuggler is not None:
        host, port = request.plotjuggler
        viewers = [block for block in diagram if isinstance(block, PlotJuggler)]
        with diagram:
            for viewer in viewers or [PlotJuggler()]:
                viewer.host, viewer.port = host, port
    if request.rerun is not None:
        viewers = [block for block in diagram if isinstance(block, Rerun)]
        with diagram:
            for viewer in viewers or [Rerun()]:
                viewer.target = request.rerun
    if request.record is not None and not any(isinstance(block, CsvRecorder) for block in diagram):
        with diagram:
            CsvRecorder()


def tell(page, event, recorder):
    """One event into the ring, which the recorder may still be emptying."""
    deadline = time.monotonic() + 5.0
    while not page.push(RECORD_EVENT, event) and recorder.alive and time.monotonic() < deadline:
        time.sleep(0.001)


def end_event(result):
    """The last event of a recording."""
    outcome = result.outcome
    return {
        "event": "end",
        "status": outcome.status,
        "culprit": outcome.culprit,
        "tick": outcome.tick,
        "signal": outcome.signal,
        "stopped": outcome.stopped,
        "overruns": result.overruns,
        "late": result.control.late,
        "answers": result.control.latencies,
        "held": result.held,
        "report": result.report,
        "faults": [[fault.status, fault.culprit, fault.tick] for fault in outcome.faults],
    }
