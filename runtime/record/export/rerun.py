"""Rerun export, with the layout in the file. Signals that were recorded at a lower rate are held in between."""

from __future__ import annotations

import os
from collections.abc import Callable

import numpy as np

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need
from runtime.record.analysis.trial import Trial
from runtime.record.recorder.rerun.scene import Scene

EXTENSIONS = {"rrd": "rrd"}
FLUSH_TIMEOUT = 60.0  # s, for a slow disk


def check(trial: Trial, kind: str) -> None:
    """Raise MissingExtra without Rerun. Arguments are not used"""
    # the library would otherwise report this on standard error
    os.environ.setdefault("RUST_LOG", "off")
    need("rerun", "a file of Rerun")


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    rr = need("rerun", "a file of Rerun")
    from runtime.record.recorder.rerun.blueprint import blueprint
    from runtime.record.recorder.rerun.stream import Stream

    about = trial.about
    scene = Scene(about["name"], about["signals"], about.get("limits", {}))
    recording = rr.RecordingStream(f"tickwork {about['name']}", recording_id=trial.path.stem)
    recording.save(path, default_blueprint=blueprint(scene))
    recording.send_recording_name(trial.path.stem)
    stream = Stream(recording, scene, about["rate"])
    done, newest = 0, np.full(2 + len(trial.signals), np.nan)
    thinned = [2 + place for path, place in trial.places.items() if trial.every(path) > 1]
    for rows, _ in trial.batches(frames=False):
        if len(rows):
            for column in thinned:
                hold(rows[:, column], newest[column])
            newest = rows[-1].copy()
            stream.rows(rows[:, 0].astype(np.int64), rows[:, 0] / about["rate"], np.ascontiguousarray(rows[:, 2:]))
        done += len(rows)
        progress(done / max(1, len(trial)))
    for event in trial.events:
        stream.event(event)
    try:
        recording.flush(timeout_sec=FLUSH_TIMEOUT)
    except RuntimeError as error:
        raise BadInput(f"cannot write {path.replace('.part.rrd', '.rrd')}: {error}; is the disk full?") from None
    recording.disconnect()


def hold(values: np.ndarray, before: float) -> None:
    """Replace each NaN by the last value before it, as viewers show it. before : last value before the array"""
    known = np.flatnonzero(~np.isnan(values))
    places = np.searchsorted(known, np.arange(len(values)), side="right")
    values[:] = np.concatenate(([before], values[known]))[places]
