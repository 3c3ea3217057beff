"""Legs of recorded walking for `bench gait`: from CSV files, from recordings, and a built-in walk."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from blocks._plumbing.csv_columns import read_table
from blocks.wearer import Walker
from graph import Diagram
from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from runtime.session.simulate import simulate
from runtime.setup.bench.gait import Leg

# Names of each signal in a CSV file, with `lt` or `rt` for SIDE; the first one that exists is used.
COLUMNS = {
    "thigh": ("thigh_pitch_SIDE_deg", "hip_flexion_SIDE_deg"),
    "shank": ("shank_pitch_SIDE_deg",),
    "knee": ("knee_flexion_SIDE_deg",),
    "contact": ("contact_SIDE", "grf_vertical_SIDE_N"),
}
SIDES = {"left": "lt", "right": "rt"}
CONTACT_LOAD = 0.05  # of the largest load: contact
SPEED = 1.2  # m/s, of the built-in walk
DURATION = 66.0  # s
RATE = 200.0  # Hz


def built_in() -> list[Leg]:
    """Return the left leg of a Walker at constant speed."""
    with Diagram("walk", RATE) as diagram:
        Walker(speed=SPEED, name="walker")()
    walk = simulate(diagram, DURATION)
    angles = {"thigh": "thigh_pitch", "shank": "shank_pitch", "knee": "knee_angle"}
    signals = {name: walk[f"walker.left_{signal}"] for name, signal in angles.items()}
    return [Leg("left", walk.time, signals, walk["walker.left_contact"].astype(float))]


def legs(path: Path, names: Mapping[str, str]) -> list[Leg]:
    """Return the legs of a CSV file or recording. names : {"left.thigh": name of the signal}

    Raises BadInput without a leg that has a contact and an angle.
    """
    time, columns, units = of_csv(path) if path.suffix == ".csv" else of_recording(path, names)
    unknown = next((name for name in names.values() if name not in columns), None)
    if unknown is not None:
        raise BadInput(f"{path} has no signal {unknown!r}; it has {', '.join(list(columns)[:20])}")
    found = []
    for side, suffix in SIDES.items():
        signals = {}
        for kind, candidates in COLUMNS.items():
            own = names.get(f"{side}.{kind}")
            choices = (own,) if own else tuple(name.replace("SIDE", suffix) for name in candidates)
            name = next((name for name in choices if name in columns and np.isfinite(columns[name]).any()), None)
            if name is not None:
                factor = math.radians(1.0) if kind != "contact" and units.get(name) == "deg" else 1.0
                signals[kind] = factor * fill_gaps(columns[name], time)
        contact = signals.pop("contact", None)
        if contact is not None and signals:
            loaded = contact > CONTACT_LOAD * max(float(np.nanmax(contact)), 1e-9)
            found.append(Leg(side, time, signals, loaded.astype(float)))
    if not found:
        raise BadInput(
            f"{path} has no leg with a contact and an angle: expected columns such as contact_lt and "
            "thigh_pitch_lt_deg, or --signal left.contact=NAME --signal left.thigh=NAME"
        )
    return found


def fill_gaps(values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return values with missing samples interpolated. time : s"""
    valid = np.isfinite(values)
    return np.interp(time, time[valid], values[valid])


def of_csv(path: Path) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, str]]:
    """Return (time, {column: values}, {column: unit}). Names end in their unit: knee_deg, or `knee [deg]`."""
    try:
        table = read_table(str(path))
        columns = {name: table.column(name, empty=math.nan) for name in table.names}
        time = table.times()
    except (OSError, ValueError) as error:
        raise BadInput(f"cannot read {path}: {getattr(error, 'strerror', None) or error}") from None
    if len(time) < 100:
        raise BadInput(f"{path} must have at least 100 rows, got {len(time)}")
    if not np.all(np.diff(time) > 0.0):
        row = int(np.argmin(np.diff(time) > 0.0)) + 1
        raise BadInput(f"{path}: the time must increase, got {time[row]:g} s after {time[row - 1]:g} s")
    units = {name: "deg" if name.endswith("_deg") else unit for name, unit in zip(table.names, table.units)}
    return time, columns, units


def of_recording(path: Path, names: Mapping[str, str]) -> tuple[np.ndarray, dict[str, np.ndarray], dict[str, str]]:
    """Return the same from a recording. names : signals to read"""
    trial = Trial(path)
    try:
        columns = {name: trial[name].astype(float) for name in names.values()}
    except KeyError as error:
        raise BadInput(error.args[0]) from None
    return trial.time, columns, {name: trial.unit(name) for name in columns}
