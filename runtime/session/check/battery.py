"""Battery budget of a robot on its rig: the largest currents, the time that a charge lasts, and their text."""

from __future__ import annotations

import signal
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import asdict, replace

from blocks.thermal import ThermalModel, loss_of_rating
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import TorqueBound
from runtime.robot.loading.recorded_signals import everything
from runtime.robot.rig.battery import continuous_current, supply_current, windings
from runtime.robot.rig.errors import CODES, RigProblem
from runtime.session.memory_trial import table

if TYPE_CHECKING:
    from graph import Diagram, Schedule, Winding
    from graph.compilation import Compilation
    from runtime.host.console.styles import Console
    from runtime.robot.loading.simulation import Simulation
    from runtime.robot.rig.battery import Battery

UNBOUND = TorqueBound("none")
SETTLING_TIME, SIMULATED_TIME = 10.0, 20.0  # s of the simulation: left out, and averaged


def loads(diagram: Diagram, analysis: Compilation) -> dict[str, Winding]:
    """Return the Winding of each actuator, at the torque that the compiler has proved.

    diagram : diagram of the robot, with its rig applied; analysis : Compilation of the diagram
    """
    torque = {proof.path: abs(proof.interval).high for proof in analysis.proofs if proof.port == "torque_command"}
    bounds = analysis.torque_bounds
    return windings(diagram, {path: torque[path] for path in torque if (bounds[path] or UNBOUND).kind == "proved"})


def budget(
    battery: Battery, drives: Mapping[str, Winding], schedule: Schedule, simulation: Simulation
) -> dict[str, Any]:
    """Return the battery budget as plain data, with the keys of `check --json`.

    drives : as returned by `loads`; simulation : simulation of that schedule. It runs if the diagram file has a plant.
    """
    continuous = [continuous_current(winding) for winding in drives.values()]
    mean = None if None in continuous else battery.load_current + sum(filter(None, continuous))
    return {
        **vars(battery),
        "energy": battery.energy,
        "drives": [
            {"actuator": path, **asdict(winding), "supply_current": supply_current(winding)}
            for path, winding in drives.items()
        ],
        "peak": peak_current(battery, drives),
        "least_time": battery.capacity / mean if mean else None,
        "simulated": simulated_use(battery, drives, schedule, simulation) if simulation.given else None,
    }


def warnings(battery: Battery, drives: Mapping[str, Winding]) -> list[dict[str, str]]:
    """Return the warnings on a battery, with the keys of the other warnings of `check`."""
    return [
        {"code": problem.code, "title": CODES[problem.code], "path": "", "port": "", "at": ""}
        | {"message": problem.message, "hint": problem.hint}
        for problem in overloads(battery, drives)
    ]


def overloads(battery: Battery, drives: Mapping[str, Winding]) -> Iterable[RigProblem]:
    """Yield a RigProblem for each way in which a battery and its fuses may not suffice for the limits of the drives."""
    for path, winding in drives.items():
        current = supply_current(winding)
        yield from _unknowns(battery, path, winding)
        if winding.supply and battery.voltage < winding.supply[0]:
            yield RigProblem(
                "TW137",
                f"[battery] of {battery.voltage:g} V is below the supply range of {path}, {winding.supply[0]:g} to "
                f"{winding.supply[1]:g} V",
                "use a battery of a higher voltage: the drive may report under-voltage under load",
            )
        if battery.fuse is not None and current is not None and current > battery.fuse:
            yield RigProblem(
                "TW137",
                f"{path} takes up to {current:.3g} A at its limit, and its fuse is rated {battery.fuse:g} A",
                f"a fuse that blows frees the joint: set limit of {path} lower, or use a larger fuse that the wires "
                "permit",
            )
    total = peak_current(battery, drives)
    if battery.max_current is not None and total > battery.max_current:
        yield RigProblem(
            "TW137",
            f"the drives and the load take up to {total:.3g} A, and the battery delivers {battery.max_current:g} A",
            "set lower limits, or use a battery with a higher permitted current",
        )


def _unknowns(battery: Battery, path: str, winding: Winding) -> Iterable[RigProblem]:
    """Yield a RigProblem for each property of a drive that no source states, and that is not compared for that reason.

    path : path of the drive
    """
    if not winding.supply:
        yield RigProblem(
            "TW137",
            f"the supply range of {path} is not published: [battery] of up to {battery.full_voltage:g} V is not "
            "compared",
            "compare it with the label of the drive or its manual",
        )
    elif winding.supply_note:
        low, high = winding.supply
        yield RigProblem(
            "TW137",
            f"the supply range of {path}, {low:g} to {high:g} V, is assumed: {winding.supply_note}",
            "compare it with the label of the drive or its manual",
        )
    if winding.current is None and (battery.fuse is not None or battery.max_current is not None):
        yield RigProblem(
            "TW137",
            f"the current of {path} is not known: fuse and max_current are not compared with it",
            "measure it, or compare the data sheet of the drive",
        )


def peak_current(battery: Battery, drives: Mapping[str, Winding]) -> float:
    """Return the largest current of the battery in A, with every drive at its limit and full modulation."""
    return battery.load_current + sum(supply_current(winding) or 0.0 for winding in drives.values())


def simulated_use(
    battery: Battery, drives: Mapping[str, Winding], schedule: Schedule, simulation: Simulation
) -> dict[str, Any] | None:
    """Run the simulation and return the mean power of the drives in W, and the time in h that the battery lasts.

    Mechanical power counts where it is positive: energy that a drive feeds back is not assumed to be stored. The heat
    of a winding is that of blocks.thermal at the torque of the simulation. None if the simulation ends early.
    """
    samples = simulated_samples(drives, schedule, simulation)
    if samples is None:
        return None
    mechanical = heat = 0.0
    for path, (torque, velocity) in samples.items():
        mechanical += float(np.mean(np.maximum(torque * velocity, 0.0)))
        heat += loss(drives[path]) * float(np.mean(torque * torque))
    power = mechanical + heat + battery.load
    return {
        "seconds": SIMULATED_TIME,
        "mechanical": mechanical,
        "heat": heat,
        "power": power,
        "time": battery.energy / power if power else None,
    }


def loss(winding: Winding) -> float:
    """Return the estimated heat of a winding in W/(N·m)²; 0 without a published rated torque."""
    names = ("winding_resistance", "case_resistance")
    resistance = sum(ThermalModel.parameters[name].default for name in names)
    return 0.0 if winding.rated is None else loss_of_rating(winding.rated, resistance)


def simulated_samples(
    drives: Mapping[str, Winding], schedule: Schedule, simulation: Simulation
) -> dict[str, tuple[np.ndarray, np.ndarray]] | None:
    """Return {path: (torque, velocity)} of the drives that measure both; None if the simulation ends early."""
    schedule = replace(schedule, **everything(schedule))
    ticks = round((SETTLING_TIME + SIMULATED_TIME) * schedule.rate)
    rows = table(ticks, 2 + len(schedule.columns))
    executor = Executor(
        Program(schedule, simulation.ends()),
        schedule.rate,
        plant=simulation.program,
        substeps=simulation.substeps,
        virtual=True,
        rows=rows,
        hosted=True,
    )
    outcome = executor.run(ticks)
    if outcome.signal:
        signal.raise_signal(outcome.signal)
    if executor.rows < ticks:
        return None
    columns = {column.path: 2 + number for number, column in enumerate(schedule.recorded)}
    after = rows[round(SETTLING_TIME * schedule.rate) :]
    return {
        path: (after[:, columns[f"{path}.torque"]], after[:, columns[f"{path}.velocity"]])
        for path in drives
        if f"{path}.torque" in columns and f"{path}.velocity" in columns
    }


def battery_lines(report: Mapping[str, Any] | None, console: Console) -> list[str]:
    """Return the lines of the section. report : as returned by `budget`, or None"""
    if report is None:
        return []
    lines = ["", *console.hang(console.bold("battery") + "  ", _size(report), console.faint)]
    width = max((len(drive["actuator"]) for drive in report["drives"]), default=0)
    for drive in report["drives"]:
        lines += console.hang(f"  {drive['actuator']:<{width}}  ", _drive(drive))
    permitted = "" if report["max_current"] is None else f"; the battery permits {report['max_current']:g} A"
    unknown = any(drive["supply_current"] is None for drive in report["drives"])
    which = "every drive with a published current" if unknown else "every drive"
    lines += console.hang("  peak       ", f"at most {report['peak']:.3g} A with {which} at its limit{permitted}")
    used = report["simulated"]
    if used is not None:
        lines += console.hang(
            "  simulated  ",
            f"{used['power']:.3g} W on average: motion {used['mechanical']:.3g} W, heat of the windings "
            f"{used['heat']:.3g} W (estimated), load {report['load']:g} W. A charge lasts {duration(used['time'])}",
        )
    if report["least_time"] is not None:
        lines += console.hang(
            "  at least   ", f"{duration(report['least_time'])}, with every drive at its rated torque and full speed"
        )
    return lines


def _size(report):
    """Return the data of the battery as text."""
    fuse = "" if report["fuse"] is None else f", {report['fuse']:g} A fuse for each drive"
    return f"{report['voltage']:g} V, {report['capacity']:g} A·h, {report['energy']:.3g} W·h{fuse}"


def _drive(drive):
    """Return the currents of one drive as text."""
    if drive["supply_current"] is None:
        return "current not published: not included"
    motor = [f"{name} {drive[f'{name}_current']:.3g} A" for name in ("rated", "peak") if drive[f"{name}_current"]]
    limit = "in a mode that does not bound the torque" if drive["limit"] is None else f"at {drive['limit']:g} N·m"
    return (
        f"at most {drive['supply_current']:.3g} A from the battery, {drive['current']:.3g} A in the motor {limit}"
        + (f" ({', '.join(motor)})" if motor else "")
    )


def duration(hours: float) -> str:
    """Return a duration as text: '35 min', '2.1 h'."""
    return f"{60.0 * hours:.0f} min" if hours < 1.5 else f"{hours:.1f} h"
