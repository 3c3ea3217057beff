"""`python -m runtime check FILE`: compile a diagram, and report its ports, schedule, proofs, buses and errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import asdict

from cext.fused.library import obstacle
from cext.safety.thresholds import PAGE_SILENCE
from graph import Device, DiagramError, Signal
from graph.assembly import assemble
from graph.compiler import examine
from graph.drawing import wired_to
from graph.drawing.cards import block_card
from graph.interval import EVERYTHING
from runtime.host.console.styles import place
from runtime.host.errors import BadInput
from runtime.record.report.failure_coverage import coverage
from runtime.record.report.preflight.table import stop_of, stopping_panel
from runtime.robot.loading.file import call_code_of_blocks, load
from runtime.robot.loading.recorded_signals import select_recorded
from runtime.robot.loading.simulation import Simulation
from runtime.robot.loading.subject import read as read_subject
from runtime.robot.rig.battery import require_supply
from runtime.robot.rig.file import read
from runtime.robot.rig.joints import require_ranges
from runtime.robot.rig.poses import Poses
from runtime.robot.rig.records import AGREES, OPEN, recorded_devices, records_of
from runtime.session.check import battery

if TYPE_CHECKING:
    from graph import Block, Diagnostic, Diagram, Schedule, TorqueBound
    from graph.caveats import Caveat
    from graph.compilation import Compilation
    from graph.schedule import Proof, Step
    from runtime.robot.loading.overrides import Settings

KEYS = """The keys of --json. Numbers are in the unit beside them; null: no bound.
  diagram, file, rate, ok  name; path; Hz; true without errors
  blocks                   path, type, module, made (file:line), runs, rate,
                           conditions, hold_exceptions, inputs, outputs
    inputs                 name, unit, shape, dtype, and source (a port),
                           constant or default
    outputs                name, unit, shape, dtype, low, high, targets
                           (ports)
  schedule                 null if there are errors
    devices, recorded      paths, in order; number of values recorded per tick
    output, update         steps in order: block, native, fused, obstacle, every,
                           rate (Hz), while, gil (index of the section that
                           holds the GIL, or null)
      fused                true if the step is part of one run of machine code
                           with the native steps around it
      obstacle             reason why a native step is not fused, else ""
    gil_sections           number of times a tick takes the GIL
    allowance              time in s that a tick may take beyond the limit
                           of the watchdog, declared by its blocks
  holds                    rate transitions: source, source_every, target,
                           target_every (ticks)
  proofs                   command, unit, low, high, limit_low, limit_high,
                           rating, bounded_by, at (file:line), slew (largest
                           rate of change of the command per second; null: no
                           bound), holds, safe_stop, assumes (further
                           condition of the torque limit; null: none)
  torque                   torque limit of each actuator: actuator, bound,
                           limit (N·m), holds, acceleration (rad/s²), figures,
                           unread (settings of the drive that arming cannot
                           read back: nothing rests on them)
    bound                  proved; assumed (while |α| <= acceleration); drive
                           (a limit in the drive); none
    figures                name, value, unit, description: usable damping,
                           smallest inertia, stall torque
  caveats                  reasons why the torque of an actuator may exceed its
                           limit: actuator, setting, words, deviates (from the
                           table of the model), factor (torque over the
                           commanded torque; null: unknown), accept (option
                           with which a rig is armed nevertheless)
  buses                    bus, medium (can, stream, i2c, spi), line (kind of stream,
                           such as gpio, "" for others), devices, coverage,
                           and if the traffic is known bitrate, data_bitrate
                           (bit/s; 0: no rate switch), frames (1/s), typical,
                           worst (share of the bitrate)
    coverage               for each failure of a run on a rig: failure,
                           covered, by (what stops the drives, or the drives
                           that nothing stops)
  page                     null unless a lost page of the panel is a stop: panel
                           (path), silence (time in s without a reply from the
                           page with the controls that ends the run)
  battery                  null without a rig that has one: its keys there, energy
                           (W·h), peak (A, at most), least_time (h), drives,
                           simulated (null without a plant)
    drives                 actuator, limit, rated (N·m), current,
                           rated_current, peak_current (amplitudes in the
                           motor, A), supply (V), supply_note (reason why it is
                           assumed, ""), supply_current (A, at most)
    simulated              seconds, mean mechanical, heat, power (W), time (h)
  records                  null without a rig; for each actuator and inertial sensor: device, serial, by
                           and date of its record (null: it rests on the table
                           alone), agrees (steps of `commission`), open (steps
                           that measured nothing), findings, mismatches (reasons
                           why the record does not apply)
  subject                  lines on the limits of the subject file, [] without one
  plant                    given (true: defined in the file), blocks, rate;
                           null without devices
  errors, warnings         code, title, path, port, at (file:line), message,
                           hint"""


def check(
    path: Path | Any,
    settings: Settings = (),
    rate: float | None = None,
    rig: str | Path | None = None,
    subject: str | Path | None = None,
) -> dict[str, Any]:
    """Check a diagram file. Returns a report as plain data with the keys above.

    path : path of the file; or a Diagram, or a function that builds one
    settings : pairs (name, text) from --set
    rate : Hz, replaces the diagram's rate
    rig : path of a rig file, whose devices and bitrates are checked
    subject : path of a subject file, whose limits the diagram gets

    Raises BadInput if a file cannot be read.
    """
    rig_file = None if rig is None else read(rig)
    person = None if subject is None else read_subject(subject)
    try:
        file, diagram = load(path, settings, rig_file, subject=person)
        path = file.path
    except BadInput as error:
        if not error.diagnostics:
            raise
        return report_of_refusal(Path(path), error.diagnostics)
    if rig_file is not None:
        require_ranges(rig_file, diagram)
        require_supply(rig_file.battery, diagram, rig_file.path)
    if rate is not None:
        diagram.rate = rate
    panel = stopping_panel(diagram)
    try:
        analysis = call_code_of_blocks(path, examine, diagram)
    except DiagramError as error:
        return report_of_refusal(path, error.diagnostics)
    errors, plant = list(analysis.errors), None
    if any(error.code == "TW010" for error in errors):  # what a block with a wrong parameter returns is not described
        return report_of_refusal(path, errors)
    budget, overloads = None, []
    schedule = None if errors else select_recorded(call_code_of_blocks(path, assemble, analysis))
    if schedule is not None:
        if rig_file is not None:
            Poses(diagram, schedule)  # a run rejects the same references and known poses
        try:
            simulation = Simulation(file, diagram, schedule)
            plant = _describe_plant(simulation)
            if rig_file is not None and rig_file.battery is not None:
                drives = battery.loads(diagram, analysis)
                budget = battery.budget(rig_file.battery, drives, schedule, simulation)
                overloads = battery.warnings(rig_file.battery, drives)
        except DiagramError as error:
            errors += error.diagnostics
        except BadInput as error:
            if not error.diagnostics:
                raise
            errors += error.diagnostics
    return {
        "diagram": diagram.name,
        "file": str(path),
        "rate": diagram.rate,
        "ok": not errors,
        "blocks": blocks(diagram, analysis),
        "schedule": None if schedule is None else _describe_schedule(schedule),
        "holds": [dict(zip(("source", "source_every", "target", "target_every"), hold)) for hold in analysis.holds],
        "proofs": [_describe_proof(proof, diagram, analysis.torque_bounds[proof.path]) for proof in analysis.proofs],
        "torque": [
            _describe_torque(diagram[path], torque)
            for path, torque in analysis.torque_bounds.items()
            if torque is not None
        ],
        "caveats": [_describe_caveat(caveat) for caveat in analysis.caveats],
        "buses": buses(diagram, schedule),
        "page": None if panel is None else {"panel": panel.path, "silence": PAGE_SILENCE * 1e-9},
        "battery": budget,
        "records": None if rig_file is None else describe_records(rig_file.path, diagram),
        "subject": [] if person is None else person.lines(diagram),
        "plant": plant,
        "errors": [_describe(d) for d in errors],
        "warnings": [_describe(d) for d in analysis.diagnostics if d.severity == "warning"] + overloads,
    }


def report_of_refusal(path: Path, diagnostics: Iterable[Diagnostic]) -> dict[str, Any]:
    """Return the report of a file whose diagram could not be built, with the same keys as that of `check`."""
    empty = {key: [] for key in ("blocks", "holds", "proofs", "torque", "caveats", "buses", "subject", "warnings")}
    return empty | {
        "diagram": path.stem,
        "file": str(path),
        "rate": None,
        "ok": False,
        "schedule": None,
        "page": None,
        "battery": None,
        "records": None,
        "plant": None,
        "errors": [_describe(d) for d in diagnostics],
    }


def describe_records(rig: Path, diagram: Diagram) -> list[dict[str, Any]]:
    """Describe the record of each actuator and inertial sensor. rig : path of the rig file"""
    records, described = records_of(rig), []
    for block in recorded_devices(diagram):
        record = records.get(block.path)
        row: dict[str, Any] = {"device": block.path, **dict.fromkeys(("serial", "by", "date"))}
        row |= {"agrees": [], "open": [], "findings": [], "mismatches": []}
        if record is not None:
            row |= {"serial": record.serial, "by": record.signed["name"], "date": record.signed["date"]}
            row["agrees"] = [name for name, step in record.steps.items() if step.verdict == AGREES]
            row["open"] = [name for name, step in record.steps.items() if step.verdict == OPEN]
            row["findings"] = [name for name, _ in record.findings]
            row["mismatches"] = record.mismatches(block)
        described.append(row)
    return described


def _bound(value: float) -> float | None:
    return value if math.isfinite(value) else None


def blocks(diagram: Diagram, analysis: Compilation) -> list[dict[str, Any]]:
    """Describe each block: devices first, then in order of execution, then sinks."""
    order = [block for block in diagram if isinstance(block, Device)] + [
        block for block in analysis.order if not isinstance(block, Device)
    ]
    order += [block for block in diagram if block not in set(order)]
    targets = wired_to(diagram, analysis)
    return [_describe_block(block, block_card(block, analysis, targets, place), analysis) for block in order]


def _describe_block(block: Block, card: Mapping[str, Any], analysis: Compilation) -> dict[str, Any]:
    keys = ("name", "unit", "shape", "dtype", "source", "constant", "default", "targets")
    sides = {
        side: [{key: port[key] for key in keys if key in port} for port in card[side]] for side in ("inputs", "outputs")
    }
    for port in sides["outputs"]:
        interval = analysis.ranges.get(Signal(block, port["name"]), EVERYTHING)
        port |= {"low": _bound(interval.low), "high": _bound(interval.high)}
    return (
        {key: card[key] for key in ("path", "type", "module", "made", "runs", "rate", "conditions")}
        | {"hold_exceptions": block.hold_exceptions}
        | sides
    )


def _describe_schedule(schedule: Schedule) -> dict[str, Any]:
    names = {signal.slot: signal.path for signal in schedule.signals.values()}
    sections = itertools.count(1)
    return {
        "devices": [device.name for device in schedule.devices],
        "recorded": len(schedule.columns),
        "output": describe_steps(schedule, schedule.output, names, sections),
        "update": describe_steps(schedule, schedule.update, names, sections),
        "gil_sections": schedule.gil_sections,
        "allowance": schedule.allowance,
    }


def describe_steps(
    schedule: Schedule, steps: Iterable[Step], names: Mapping[int, str], sections: Iterator[int]
) -> list[dict[str, Any]]:
    """Describe the steps of one phase.

    names : {slot: path} of the signals
    sections : iterator of indices of sections that hold the GIL
    """
    described, gil = [], None
    for step in steps:
        native = step.kernel is not None
        gil = None if native else gil or next(sections)
        reason = obstacle(step.kernel, step.table.sizes) if native else ""
        described.append(
            {
                "block": step.name,
                "native": native,
                "fused": native and not reason,
                "obstacle": reason,
                "every": step.every,
                "rate": schedule.rate / step.every,
                "while": [names[slot] for slot in step.conditions],
                "gil": gil,
            }
        )
    return described


def _describe_torque(block: Any, torque: TorqueBound) -> dict[str, Any]:
    return {
        "actuator": block.path,
        "unread": list(block.unread_settings),
        "bound": torque.kind,
        "limit": torque.limit,
        "holds": torque.holds or None,
        "acceleration": torque.acceleration,
        "figures": [dict(zip(("name", "value", "unit", "description"), figure)) for figure in torque.figures],
    }


def _describe_caveat(caveat: Caveat) -> dict[str, Any]:
    return {
        "actuator": caveat.path,
        "setting": caveat.setting,
        "words": caveat.words,
        "deviates": caveat.deviates,
        "factor": caveat.factor,
        "accept": f"--accept {caveat.name}",
    }


def _describe_proof(proof: Proof, diagram: Diagram, torque: TorqueBound | None) -> dict[str, Any]:
    source, actuator = diagram.blocks.get(proof.bounded_by), diagram[proof.path]
    return {
        "command": f"{proof.path}.{proof.port}",
        "unit": proof.unit,
        "low": _bound(proof.interval.low),
        "high": _bound(proof.interval.high),
        "limit_low": _bound(proof.limit.low),
        "limit_high": _bound(proof.limit.high),
        "rating": actuator.rating(),
        "bounded_by": proof.bounded_by,
        "at": place(source.location) if source is not None else "",
        "slew": _bound(source.output_slew) if source is not None and source.output_slew is not None else None,
        "holds": proof.holds,
        "safe_stop": stop_of(actuator),
        "assumes": (torque and torque.holds) or None,
    }


def buses(diagram: Diagram, schedule: Schedule | None) -> list[dict[str, Any]]:
    """Describe each bus: its devices, and its load if the schedule has computed it."""
    every_device = [block for block in diagram if isinstance(block, Device)]
    devices = {}
    for block in every_device:
        devices.setdefault(block.bus, []).append(block)
    loads = {load.bus: load for load in schedule.loads} if schedule is not None else {}
    return [
        {
            "bus": bus,
            "medium": own[0].medium,
            "line": getattr(own[0], "line", ""),
            "devices": [block.path for block in own],
            "coverage": coverage(own, every_device, stopping_panel(diagram) is not None),
        }
        | (asdict(loads[bus]) if bus in loads else {})
        for bus, own in sorted(devices.items())
    ]


def _describe_plant(simulation: Simulation) -> dict[str, Any] | None:
    if simulation.plant is None or simulation.diagram is None:
        return None
    return {"given": simulation.given, "blocks": len(simulation.diagram), "rate": simulation.plant.rate}


def _describe(diagnostic: Diagnostic) -> dict[str, str]:
    where = place(diagnostic.where) if diagnostic.where else ""
    return {
        "code": diagnostic.code,
        "title": diagnostic.title,
        "path": diagnostic.path,
        "port": diagnostic.port,
        "at": where,
        "message": diagnostic.message,
        "hint": diagnostic.hint,
    }
