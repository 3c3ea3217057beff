"""A run in stages: prepare (runtime.session.prepare), arm, run (runtime.session.armed).

    result = Session(prepare(request)).carry_out()

A run owns the shared state, the guardian of a rig, the recorder process, real-time priority and the executor. If `arm`
fails, it releases everything that it has acquired.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from contextlib import ExitStack
from typing import TYPE_CHECKING

from cext.memory.shared_state import SharedState
from cext.safety.terminal_keys import KeyReader
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from runtime.host.live.table import describe
from runtime.host.machine.realtime import PRIORITY, Realtime
from runtime.host.machine.sleep import SleepInhibitor
from runtime.record.recorder import RecorderProcess, can_ask
from runtime.record.report.preflight.table import stopping_panel
from runtime.session.armed import Armed
from runtime.session.rearming import Rearming
from runtime.session.recording_plan import needs_process, plan, ring_bytes

if TYPE_CHECKING:
    from typing import TypeAlias

    from runtime.record.recorder.local import LocalRecorder
    from runtime.record.recorder.plan_types import Plan
    from runtime.session.prepare import Prepared
    from runtime.session.result import Result

    Recorder: TypeAlias = RecorderProcess | LocalRecorder


class Session:
    """One run.

    prepared : Prepared
    say : function that shows lines to the operator before the run
    count_from : first tick in which missing replies are counted
    recorder : function that starts the recorder of a shared state; None for the usual one
    waiting : RecorderProcess without a shared state that the run uses, None to start one
    """

    def __init__(
        self,
        prepared: Prepared,
        say: Callable[[list[str]], object] = lambda lines: None,
        count_from: int = 0,
        recorder: Callable[[SharedState], Recorder] | None = None,
        waiting: RecorderProcess | None = None,
    ) -> None:
        self.prepared, self.say, self.count_from = prepared, say, count_from
        self.start_recorder = recorder or self.usual_recorder
        self.waiting = waiting

    def carry_out(self) -> Result:
        """Arm, run and finish. Returns a Result; raises as `arm` does."""
        return self.arm().run()

    def arm(self) -> Armed:
        """Take everything that the run needs; no frame is sent yet.

        Raises RigError, RecorderError or RealtimeRefused, and then gives everything back.
        """
        prepared, request, rig = self.prepared, self.prepared.request, self.prepared.rig
        inhibitor = keys = None
        with ExitStack() as undo:
            waiting = self.waiting if self.waiting is not None and self.waiting.usable else None
            shared = SharedState(
                ring_bytes(prepared.schedule),
                live=describe(prepared.schedule),
                empty=None if waiting is None else waiting.memory,
            )
            if rig is not None:  # the guardian comes first: without it nothing is armed
                undo.callback(rig.close)
                inhibitor = SleepInhibitor(f"{prepared.diagram.name} {'drives motors' if rig.commands else 'measures'}")
                undo.callback(inhibitor.release)
                priority = None if request.realtime == "off" else request.priority or PRIORITY
                rig.watch(shared, prepared.schedule, prepared.diagram, priority)
            # before the priority, memory lock and processor of the loop
            recorder = waiting or self.start_recorder(shared)
            undo.callback(recorder.abandon)
            realtime = Realtime(request.realtime or "off", request.priority or PRIORITY, request.cpu)
            undo.callback(realtime.release)
            realtime.obtain()
            aside = self.keep_others_aside(realtime, recorder)
            self.say(self.remarks(realtime, inhibitor))
            recording = self.plan(realtime)
            recorder.configure(recording)
            if recording["keys"] and (terminal := getattr(recorder, "terminal", None)) is not None:
                keys = KeyReader(shared, terminal, aside)
                undo.callback(keys.stop)
            control = self.program()
            executor = self.executor(control, shared, recorder, aside)
            rearming = Rearming(prepared, shared, control, executor, can_ask())
            realtime.prefault()
            undo.pop_all()
        return Armed(prepared, shared, recorder, realtime, control, executor, rearming, inhibitor, keys)

    def usual_recorder(self, shared: SharedState) -> Recorder:
        """Return the recorder of the run: a process, or a LocalRecorder where nothing is recorded."""
        if needs_process(self.prepared):
            return RecorderProcess(shared)
        from runtime.record.recorder.local import LocalRecorder

        return LocalRecorder(shared)

    def plan(self, realtime: Realtime) -> Plan:
        """Return the plan of the recorder."""
        return plan(self.prepared, realtime)

    def program(self) -> Program:
        """Return the program of the robot."""
        control = Program(self.prepared.schedule, self.prepared.ends())
        control.count_from(self.count_from)
        return control

    def keep_others_aside(self, realtime: Realtime, recorder: Recorder) -> Collection[int]:
        """Move the other processes of the run off the loop's processor.

        Returns the numbers of the processors left to them.
        """
        aside = realtime.others if realtime.processor is not None else ()
        rig = self.prepared.rig
        if realtime.others and not self.prepared.request.fast:
            recorder.keep_to(realtime.others)
        if aside and rig is not None and rig.guardian is not None:
            rig.guardian.bring_to(aside)
        return aside

    def remarks(self, realtime: Realtime, inhibitor: SleepInhibitor | None) -> list[str]:
        """Return lines for the operator before the run. inhibitor : of a rig, else None"""
        if self.prepared.rig is None or inhibitor is None:
            return realtime.lines()
        return [*self.prepared.rig.remarks(), *realtime.lines(), *realtime.risk(), *inhibitor.remarks()]

    def executor(self, control: Program, shared: SharedState, recorder: Recorder, aside: Collection[int]) -> Executor:
        """Return the Executor of a program. aside : numbers of the processors for other threads"""
        request, rig = self.prepared.request, self.prepared.rig
        return Executor(
            control,
            self.prepared.schedule.rate,
            plant=self.prepared.plant,
            substeps=self.prepared.substeps,
            shared=shared,
            virtual=request.fast,
            reader=recorder.lifeline,
            drain=getattr(recorder, "drain", None),
            replay=None if self.prepared.feed is None else self.prepared.feed.clock,
            overrun=request.overrun,
            spin=request.spin,
            profile=request.profile,
            guard=rig.guardian_silence if rig is not None else 0.0,
            grace=rig.grace if rig is not None else 0.0,
            carried=rig is not None and rig.carries,
            others=aside,
            waits=rig is None and self.prepared.plant is not None,
            pages=stopping_panel(self.prepared.diagram) is not None,
            **self.prepared.ramp,
        )
