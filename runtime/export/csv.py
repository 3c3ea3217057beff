"""CSV export, byte for byte as the recorder writes it."""

from runtime.recorder.csv import Lines, header
from runtime.recording.ascii_units import ascii_name

CHUNK = 1000  # rows


def check(trial, kind):
    pass


def write(trial, path, progress):
    columns = [{**signal, "ascii_unit": ascii_name(signal["unit"])} for signal in trial.signals.values()]
    line = Lines(columns).line
    with open(path, "wb") as file:
        file.write(header(columns, ",").encode())
        for first in range(0, len(trial), CHUNK):
            rows = slice(first, first + CHUNK)
            file.writelines(map(line, trial.time[rows].tolist(), trial.tick[rows].tolist(), trial.rows[rows].tolist()))
            progress(first / len(trial))
