"""OpenSim export: .sto with every signal, .mot with the joint angles, in rad.

OpenSim's older reader ends, without an error, at the first cell that is not a number: nan and infinities are filled in.
Both are text: a header with the units, then tab-separated columns: `time`, and one for each number, named by its path
or by --names. Rows are evenly spaced, as OpenSim's filters and tools require. OpenSim's older reader also splits names
at spaces, and takes a header line with `=` as a setting: names contain neither here. (OpenSim's documentation, Storage
(.sto) Files)
"""

from __future__ import annotations

import copy
import re
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from runtime.host.console.styles import count
from runtime.host.errors import BadInput
from runtime.host.suggestions import suggestion
from runtime.host.unique_name import unique
from runtime.record.analysis.resample import interpolate, kind_of
from runtime.record.analysis.trial import Trial
from runtime.record.analysis.trial_data import split

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

EXTENSIONS = {"sto": "sto", "mot": "mot"}
GROUP = 10_000  # rows that are checked at once
EXAMPLE = '"left/knee.position" = "knee_angle_l"'


def read_names(path: Path) -> dict[str, str]:
    """Read {signal: coordinate} from a TOML file with lines like "left/knee.position" = "knee_angle_l".

    Raises BadInput.
    """
    from cext.user_files import read_small  # compiled, which a recording is read without

    try:
        content = tomllib.loads(read_small(path).decode("utf-8-sig"))
    except OSError as error:
        raise BadInput(f"--names {path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise BadInput(f"--names {path}: not UTF-8 text") from None
    except (ValueError, RecursionError) as error:
        raise BadInput(f"--names {path}: invalid TOML: {error}; write {EXAMPLE}") from None
    if not content:
        raise BadInput(f"--names {path}: no signals; write {EXAMPLE}")
    taken = {"time": "the time"}
    for signal, name in content.items():
        if not isinstance(name, str):
            raise BadInput(f"--names {path}: {signal!r} has no coordinate name; write {EXAMPLE}, both in quotes")
        if not name.isprintable() or not re.fullmatch(r"[^\s=]+", name):
            raise BadInput(
                f"--names {path}: {signal!r}: {name!r} is not a valid column name: use letters, and "
                "no space, = or control character"
            )
        if name in taken:
            raise BadInput(f"--names {path}: {signal!r}: {name!r} is already the name of {taken[name]}")
        taken[name] = repr(signal)
    return content


def rename_signals(trial: Trial, names: dict[str, str], path: Path) -> Trial:
    """Return a Trial whose signals have the names of coordinates. names : from `read_names(path)`. Raises BadInput."""
    for signal in names:
        if signal not in trial.signals:
            hint = suggestion(signal, trial.signals)
            raise BadInput(
                f"--names {path}: {trial.path.name} has no signal {signal!r}" + (f": {hint}" if hint else "")
            )
    made = copy.copy(trial)
    made.signals = {
        signal: entry | ({"coordinate": names[signal]} if signal in names else {})
        for signal, entry in trial.signals.items()
    }
    return made


def count_missing_ticks(trial: Trial) -> int:
    """Return the number of missing ticks between the first and the last."""
    return int(trial.tick[-1] - trial.tick[0]) + 1 - len(trial) if len(trial) else 0


def check(trial: Trial, kind: str) -> None:
    """Raise BadInput for a .mot file without coordinates, or with one in another unit than rad or m.

    kind : "sto" or "mot"
    """
    if kind == "mot" and not coordinates(trial):
        raise BadInput(
            f"{trial.path} has no joint angle: .mot contains signals called `position` or `angle`, in rad, "
            "or those that --names lists; "
            ".sto contains all"
        )
    for path in coordinates(trial) if kind == "mot" else ():
        if trial.unit(path) not in ("rad", "m"):
            raise BadInput(
                f"{path} is in {trial.unit(path)}: .mot contains coordinates, in rad or m; .sto contains all signals"
            )


def coordinates(trial: Trial) -> list[str]:
    """Return the signals of a .mot file: those that --names lists, else every joint angle."""
    return [path for path, signal in trial.signals.items() if "coordinate" in signal] or [
        path
        for path, signal in trial.signals.items()
        if signal["unit"] == "rad" and path.rpartition(".")[2] in ("position", "angle")
    ]


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file, with missing rows and samples filled in by Trial.resample.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    if count_missing_ticks(trial) or any(trial.every(name) > 1 for name in trial.signals):
        trial = trial.resample(trial.about["rate"])
    filled = finite(trial, path)
    paths = [name for name in signals_of_file(trial, path) if name in filled]
    places, rate, done = [2 + trial.places[name] for name in paths], trial.about["rate"], 0
    whole = np.array([trial.signals[name]["dtype"] != "float" for name in paths])
    units = "\t".join(trial.signals[name]["unit"] for name in paths)
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        file.write(
            f"{trial.about['name'].replace('=', '_')}\nversion=1\nnRows={len(trial)}\nnColumns={1 + len(paths)}\n"
            f"inDegrees=no\nDataType=double\nunits=s\t{units}\nendheader\n"
        )
        file.write("\t".join(["time", *labels(trial.signals[path].get("coordinate", path) for path in paths)]) + "\n")
        for rows, _ in trial.batches(frames=False):
            table = rows[:, places]
            for column, name in enumerate(paths):
                if (values := filled[name]) is not None:
                    table[:, column] = values[done : done + len(rows)]
            for time, values in zip((rows[:, 0] / rate).tolist(), table.tolist()):
                file.write(
                    "\t".join([repr(time), *(text(value, is_whole) for value, is_whole in zip(values, whole))]) + "\n"
                )
            done += len(rows)
            progress(done / max(1, len(trial)))


def signals_of_file(trial: Trial, path: str) -> list[str]:
    """Return the signals of a file. path : path of the file"""
    return coordinates(trial) if path.endswith(".mot") else list(trial.signals)


def finite(trial: Trial, path: str) -> dict[str, np.ndarray | None]:
    """Return {signal: its values with every nan and infinity filled in; None if all are numbers} of a file.

    A signal without any number is left out. path : path of the file
    """
    counts = not_numbers(trial, path)
    filled: dict[str, np.ndarray | None] = {}
    for name in signals_of_file(trial, path):
        if not counts[name]:
            filled[name] = None
        elif counts[name] < len(trial):
            values = trial.values([trial.places[name]])
            known, kind = np.isfinite(values[:, 0]), kind_of(trial, split(name)[0])
            times = trial.time[known]
            between = np.clip(trial.time, times[0], times[-1])
            filled[name] = interpolate("straight" if kind == "turning" else kind, times, values[known], between)[:, 0]
    return filled


def not_numbers(trial: Trial, path: str) -> dict[str, int]:
    """Return {signal: number of its samples that are nan or infinite} of a file. path : path of the file"""
    names = signals_of_file(trial, path)
    counts = np.zeros(len(names), dtype=int)
    places = [trial.places[name] for name in names]
    for group in trial.row_groups(GROUP, places):
        counts += np.count_nonzero(~np.isfinite(group.values), axis=0)
    return dict(zip(names, counts.tolist()))


def remarks(trial: Trial, path: str) -> list[str]:
    """Return what differs in a file from the recording, as lines of text. path : path of the file"""
    name, lines = Path(path).name, []
    if missing := count_missing_ticks(trial):
        lines.append(f"{name}: {count(missing, 'missed tick')} filled in: OpenSim requires equally spaced times")
    for signal, wrong in not_numbers(trial, path).items():
        every = trial.every(signal)
        wrong -= len(trial) - len(trial.time_of(signal)) if every > 1 else 0
        if wrong and wrong == len(trial.time_of(signal)):
            lines.append(f"{name}: {signal} is left out: it has no number")
        elif wrong:
            lines.append(
                f"{name}: {signal}: {count(wrong, 'sample')} with nan or inf filled in from the samples beside them: "
                "OpenSim reads no row after one"
            )
    return lines


def labels(names: Iterable[str]) -> list[str]:
    """Return the names of columns, without spaces, each once."""
    made = {}  # ordered
    for name in names:
        made[unique(re.sub(r"\s", "_", name), made.__contains__)] = None
    return list(made)


def text(value: float, whole: bool) -> str:
    """Return the fewest digits that read back as the same number. whole : whether it is an int or bool"""
    return str(int(value)) if whole and np.isfinite(value) else repr(value)
