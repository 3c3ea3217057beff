"""Battery budget of a robot on its rig: the largest currents, and the time that a charge lasts."""

from __future__ import annotations

import signal
from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from blocks.thermal import ThermalModel, loss_of_rating
from cext.schedule.executor import Executor
from cext.schedule.program import Program
from graph import TorqueBound
from runtime.robot.loading.recorded_signals import everything
from runtime.robot.rig.battery import continuous_current, overloads, peak_current, supply_current, windings
from runtime.robot.rig.errors import CODES
from runtime.session.memory_trial import table

if TYPE_CHECKING:
    from graph import Diagram, Schedule, Winding
    from graph.compilation import Compilation
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
        **asdict(battery),
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
