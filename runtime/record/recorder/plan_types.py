"""Types of the plan of a recording, which JSON can carry, for type checkers only."""

from __future__ import annotations

from typing import Any, TypedDict

PlanColumn = dict[str, Any]  # index, path, dtype and unit of a recorded signal


class _Sink(TypedDict):
    service: str  # key of runtime.record.recorder.plugins.SERVICES
    path: str
    parameters: dict[str, Any]
    columns: list[PlanColumn]  # also with `labels` of states, and the unit in ASCII


class PlanSink(_Sink, total=False):
    """Sink of a diagram."""

    every: int  # ticks
    wanted: bool  # whether the command line requests it


class PlanBefore(TypedDict):
    """Earlier parts of a recording, whose writers have died."""

    stem: str
    files: dict[str, str]  # {path: remark}
    logs: list[str]  # incomplete flight logs
    problems: list[str]
    lost: int  # records
    kept: dict[str, dict[str, Any]]  # {path of a sink: what its service passes on}


class Surroundings(TypedDict):
    """What user code may change before the plan is sent, and the recorder process takes over."""

    folder: str | None  # working folder, None if it was deleted
    path: list[str]  # of imports
    environment: dict[str, str]


class _Plan(TypedDict):
    name: str  # of the diagram
    stem: str  # of the files
    folder: str | None  # None to write no files
    rate: float  # Hz
    duration: float | None  # s
    virtual: bool  # the files of two equal runs are then byte-identical
    simulated: bool  # by a plant
    compression: str  # of the .mcap file: "zstd", "zstd:LEVEL" or "none"
    can_log: bool
    signals: list[PlanColumn]
    limits: dict[str, tuple[float, float]]  # {path: (lowest, highest)} of the recorded signals with known limits
    states: dict[str, list[str]]  # {path: names of its values 0, 1, ...} of the states of state machines
    buses: list[str]
    media: list[str]  # of each bus
    bitrates: dict[str, float]  # {bus: bit/s}
    data_bitrates: dict[str, float]  # {bus: bit/s of CAN FD's data phase} of the buses that switch the rate
    items: list[str]  # names of the stopwatch items, as in cext.clock.stopwatch.names
    sinks: list[PlanSink]
    status_line: bool  # whether the terminal shows a status line
    keys: bool  # whether the keys of the terminal are carried out
    diagram_json: str | None
    control_pid: int
    metadata: dict[str, Any]  # further content of the sidecar file


class Plan(_Plan, total=False):
    """Plan of a recording."""

    drives: dict[str, int]  # {path of an actuator: its number among the devices of the schedule}
    hot: dict[str, float]  # {path of a temperature: °C at which the run ends}
    secret: str  # from which the tokens of a panel are made
    phases: dict[str, str]  # {gait phase: what is true while it is known}, for a panel
    drawing: str | None  # SVG of the diagram, for a panel
    surroundings: Surroundings  # of the control process; services do not see it
    part: int  # 1 by default; later ones follow the death of a writer
    before: PlanBefore
    stopped: bool  # whether a signal has ended the run, for `Service.conclude`
