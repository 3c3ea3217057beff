"""Recordings in other formats: every sample of every signal, in order, to the bit where the format has doubles.

mcap        finished, with an index, and in one file, whatever became of its recorder
csv         as the recorder writes it
parquet     a column a number, in its own type, units as metadata
mat         MATLAB: a nested struct with units and time
rrd         Rerun, with a blueprint made from the recording
sto, mot    OpenSim: all signals; joint angles

An installed package adds a format in the entry-point group "tickwork.formats", under the ending of its files:

    [project.entry-points."tickwork.formats"]
    h5 = "mylab.hdf5"

Its module has two functions:

    check(trial, kind)              raises BadInput or MissingExtra for a Trial that the format cannot hold
    write(trial, path, progress)    writes the file; `progress` is called with the share that is done, 0 to 1
"""

import os
from contextlib import suppress

from runtime.base.plugins import Plugins
from runtime.recording.files import create

FORMATS = Plugins(
    "tickwork.formats",
    {
        "mcap": "runtime.export.mcap",
        "csv": "runtime.export.csv",
        "parquet": "runtime.export.parquet",
        "mat": "runtime.export.matlab",
        "rrd": "runtime.export.rerun",
        "sto": "runtime.export.opensim",
        "mot": "runtime.export.opensim",
    },
)
OPENSIM = ("sto", "mot")


def convert(trial, kind, stem, progress=lambda share: None):
    """Write a Trial as `stem` and the ending of its kind, or with a number in between where that exists. Returns the
    path.

    The file has its name once it is whole: who finds one, after a power cut too, has every sample.

    progress : called with the share that is done. BadInput, MissingExtra, OSError; nothing is then left behind.
    """
    module = FORMATS.load(kind)
    module.check(trial, kind)
    path = part = reserved(stem, kind)
    try:
        part = reserved(f"{path.removesuffix(f'.{kind}')}.part", kind)
        module.write(trial, part, progress)
        os.replace(part, path)
    except BaseException:
        for made in {part, path}:
            with suppress(FileNotFoundError):
                os.unlink(made)
        raise
    return path


def reserved(stem, kind):
    """A path that no file had, and an empty one has now."""
    path, descriptor = create(stem, f".{kind}")
    os.close(descriptor)
    return path
