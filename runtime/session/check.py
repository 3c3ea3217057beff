"""`python -m runtime check FILE`: compiles a diagram and tells what was found: ports, schedule, proof, buses, and what
is wrong.
"""

import itertools
import json
import math
from dataclasses import asdict

from graph import Device, DiagramError, Signal
from graph.assembly import assemble
from graph.compiler import examine
from graph.drawing import wired_to
from graph.drawing.cards import block_card
from graph.interval import EVERYTHING
from runtime.base.errors import BadInput
from runtime.console.styles import console_for, place
from runtime.diagrams.file import blamed, load
from runtime.diagrams.simulation import Simulation
from runtime.report.check import text
from runtime.report.failure_coverage import coverage
from runtime.rig import read, require_ranges
from runtime.session.preflight import stop_of

KEYS = """The keys of --json. Numbers are in the unit beside them; null stands for no bound.
  diagram, file, rate, ok       name; path; Hz; whether nothing is wrong
  blocks                        path, type, module, made (file:line), runs, rate, conditions, hold_exceptions, inputs,
                                outputs
    inputs                        name, unit, shape, dtype, and source (a port), constant or default
    outputs                       name, unit, shape, dtype, low, high, targets (ports)
  schedule                      null where something is wrong
    devices, recorded             paths, in order; how many numbers are recorded each tick
    output, update                steps in order: block, native, every, rate (Hz), while, gil (number of the hold of the
                                  GIL, or null)
    gil_sections                  how often a tick takes the GIL
  holds                         where rates meet: source, source_every, target, target_every (ticks)
  proofs                        command, unit, low, high, limit_low, limit_high, rating, bounded_by, at (file:line),
                                slew (fastest change of the command in its unit per second; null where nothing bounds
                                it), holds, safe_stop,
                                assumes (on what the torque limit of its actuator rests besides; null for nothing)
  torque                        what bounds the torque of each actuator: actuator, bound, limit (N·m), holds,
                                acceleration (rad/s²), figures
    bound                         proved; assumed, while |α| <= acceleration; drive, by a limit in the drive; none
    figures                       name, value, unit, description: usable damping, smallest inertia, what a stall can add
  buses                         bus, medium (can, stream, i2c), devices, coverage, and where its traffic is known
                                bitrate (bit/s), frames (1/s), typical, worst (of the bitrate)
    coverage                      of each failure of a run on a rig: failure, covered, by (what stops the drives, or
                                  which drives nothing stops)
  plant                         given (by the file), blocks, rate; null without devices
  errors, warnings              code, title, path, port, at (file:line), message, hint"""


def told(found, as_json):
    """Lines of what was found."""
    return [json.dumps(found, indent=1, ensure_ascii=False)] if as_json else text(found, console_for())


def check(path, settings=(), rate=None, rig=None):
    """What there is to tell of a diagram file, as plain data with the keys above. Raises BadInput for a file that
    cannot be read.

    settings : pairs (name, text) from --set
    rate : Hz instead of the diagram's own
    rig : path of a rig file; its devices and bitrates are what is checked
    """
    rig = None if rig is None else read(rig)
    try:
        file, diagram = load(path, settings, rig)
    except BadInput as error:
        if not error.diagnostics:
            raise
        return refused(path, error.diagnostics)
    if rig is not None:
        require_ranges(rig, diagram)
    if rate is not None:
        diagram.rate = rate
    found = blamed(path, examine, diagram)
    errors, plant = list(found.errors), None
    schedule = None if errors else blamed(path, assemble, found)
    if schedule is not None:
        try:
            plant = describe_plant(Simulation(file, diagram, schedule))
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
        "blocks": blocks(diagram, found),
        "schedule": None if schedule is None else describe_schedule(schedule),
        "holds": [dict(zip(("source", "source_every", "target", "target_every"), hold)) for hold in found.holds],
        "proofs": [describe_proof(proof, diagram, found.torque_bounds[proof.path]) for proof in found.proofs],
        "torque": [describe_torque(path, torque) for path, torque in found.torque_bounds.items() if torque is not None],
        "buses": buses(diagram, schedule),
        "plant": plant,
        "errors": [describe(d) for d in errors],
        "warnings": [describe(d) for d in found.diagnostics if d.severity == "warning"],
    }


def refused(path, diagnostics):
    """What is told of a file whose diagram could not be made."""
    nothing = {key: [] for key in ("blocks", "holds", "proofs", "torque", "buses", "warnings")}
    return nothing | {
        "diagram": path.stem,
        "file": str(path),
        "rate": None,
        "ok": False,
        "schedule": None,
        "plant": None,
        "errors": [describe(d) for d in diagnostics],
    }


def bound(value):
    return value if math.isfinite(value) else None


def blocks(diagram, found):
    """Each block with its ports: devices first, then as they run, then what only takes."""
    order = [block for block in diagram if isinstance(block, Device)] + [
        block for block in found.order if not isinstance(block, Device)
    ]
    order += [block for block in diagram if block not in set(order)]
    targets = wired_to(diagram, found)
    return [describe_block(block, block_card(block, found, targets, place), found) for block in order]


def describe_block(block, card, found):
    keys = ("name", "unit", "shape", "dtype", "source", "constant", "default", "targets")
    sides = {
        side: [{key: port[key] for key in keys if key in port} for port in card[side]] for side in ("inputs", "outputs")
    }
    for port in sides["outputs"]:
        interval = found.ranges.get(Signal(block, port["name"]), EVERYTHING)
        port |= {"low": bound(interval.low), "high": bound(interval.high)}
    return (
        {key: card[key] for key in ("path", "type", "module", "made", "runs", "rate", "conditions")}
        | {"hold_exceptions": block.hold_exceptions}
        | sides
    )


def describe_schedule(schedule):
    names = {signal.slot: signal.path for signal in schedule.signals.values()}
    sections = itertools.count(1)
    return {
        "devices": [device.name for device in schedule.devices],
        "recorded": len(schedule.columns),
        "output": describe_steps(schedule, schedule.output, names, sections),
        "update": describe_steps(schedule, schedule.update, names, sections),
        "gil_sections": schedule.gil_sections,
    }


def describe_steps(schedule, steps, names, sections):
    """The steps of one phase. sections : hands out the numbers of the holds of the GIL."""
    described, gil = [], None
    for step in steps:
        native = step.kernel is not None
        gil = None if native else gil or next(sections)
        described.append(
            {
                "block": step.name,
                "native": native,
                "every": step.every,
                "rate": schedule.rate / step.every,
                "while": [names[slot] for slot in step.conditions],
                "gil": gil,
            }
        )
    return described


def describe_torque(path, torque):
    return {
        "actuator": path,
        "bound": torque.kind,
        "limit": torque.limit,
        "holds": torque.holds or None,
        "acceleration": torque.acceleration,
        "figures": [dict(zip(("name", "value", "unit", "description"), figure)) for figure in torque.figures],
    }


def describe_proof(proof, diagram, torque):
    source, actuator = diagram.blocks.get(proof.bounded_by), diagram[proof.path]
    return {
        "command": f"{proof.path}.{proof.port}",
        "unit": proof.unit,
        "low": bound(proof.interval.low),
        "high": bound(proof.interval.high),
        "limit_low": bound(proof.limit.low),
        "limit_high": bound(proof.limit.high),
        "rating": actuator.rating(),
        "bounded_by": proof.bounded_by,
        "at": place(source.location) if source is not None else "",
        "slew": bound(source.output_slew) if source is not None and source.output_slew is not None else None,
        "holds": proof.holds,
        "safe_stop": stop_of(actuator),
        "assumes": (torque and torque.holds) or None,
    }


def buses(diagram, schedule):
    """Every bus with who is on it, and its load as far as the schedule knows it."""
    everything = [block for block in diagram if isinstance(block, Device)]
    devices = {}
    for block in everything:
        devices.setdefault(block.bus, []).append(block)
    loads = {load.bus: load for load in schedule.loads} if schedule is not None else {}
    return [
        {
            "bus": bus,
            "medium": own[0].medium,
            "devices": [block.path for block in own],
            "coverage": coverage(own, everything),
        }
        | (asdict(loads[bus]) if bus in loads else {})
        for bus, own in sorted(devices.items())
    ]


def describe_plant(simulation):
    if simulation.plant is None:
        return None
    return {"given": simulation.given, "blocks": len(simulation.diagram), "rate": simulation.plant.rate}


def describe(diagnostic):
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
