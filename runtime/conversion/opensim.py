"""OpenSim: .sto with every signal, .mot with the joint angles alone, in rad.

Both are text: a header, then `time` and a column a number, named by its path, between tabs. Units stand in the header. OpenSim's older reader
parts names at spaces, too, and takes a line with `=` in the header for a setting: names have neither here. (OpenSim's documentation, Storage
(.sto) Files)
"""

import re

import numpy as np

from runtime.errors import BadInput

CHUNK = 1000                    # rows


def check(trial, kind):
    if kind == "mot" and not angles(trial):
        raise BadInput(f"{trial.path} has no joint angle: .mot holds signals called `position` or `angle`, in rad; .sto holds all")


def angles(trial):
    return [path for path, signal in trial.signals.items() if signal["unit"] == "rad" and path.rpartition(".")[2] in ("position", "angle")]


def write(trial, path, progress):
    paths = angles(trial) if path.endswith(".mot") else list(trial.signals)
    places = [trial.places[name] for name in paths]
    whole = np.array([trial.signals[name]["dtype"] != "float" for name in paths])
    units = "\t".join(trial.signals[name]["unit"] for name in paths)
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(
            f"{trial.about['name'].replace('=', '_')}\nversion=1\nnRows={len(trial)}\nnColumns={1 + len(paths)}\ninDegrees=no\nDataType=double\n"
            f"units=s\t{units}\nendheader\n")
        file.write("\t".join(["time", *labels(paths)]) + "\n")
        for first in range(0, len(trial), CHUNK):
            rows = slice(first, first + CHUNK)
            for time, values in zip(trial.time[rows].tolist(), trial.rows[rows, places].tolist()):
                file.write("\t".join([repr(time), *(text(value, is_whole) for value, is_whole in zip(values, whole))]) + "\n")
            progress(first / len(trial))


def labels(paths):
    """Names of columns: without a space, each once."""
    made = {}
    for path in paths:
        name = chosen = re.sub(r"\s", "_", path)
        number = 1
        while chosen in made:
            number += 1
            chosen = f"{name}_{number}"
        made[chosen] = path
    return list(made)


def text(value, whole):
    """The fewest digits that read back as the same number."""
    return str(int(value)) if whole and np.isfinite(value) else repr(value)
