"""Conversion of recordings to other formats: every sample of every signal, exact if the format has doubles.

mcap        complete, with an index, in one file
csv         as the recorder writes it
parquet     one column a number, in its type, with units as metadata
mat         MATLAB: a nested struct with units and time
rrd         Rerun, with a blueprint from the recording
sto, mot    OpenSim: all signals; joint angles

An installed package adds a format in the entry-point group "tickwork.formats", under its file name extension:

    [project.entry-points."tickwork.formats"]
    h5 = "mylab.hdf5"

Its module has two functions:

    check(trial, kind)              raises BadInput or MissingExtra for a Trial that the format cannot hold
    write(trial, path, progress)    writes the file; `progress` is called with the fraction that is done, 0 to 1
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
    """Write a Trial as `stem` with the extension of its kind, numbered if that exists. Returns the path.

    The file is renamed after it is complete, so that a file with this name has every sample, even after a power loss.

    progress : called with the fraction that is done

    Raises BadInput, MissingExtra or OSError, with nothing left behind.
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
    """Create an empty file under an unused path, and return the path."""
    path, descriptor = create(stem, f".{kind}")
    os.close(descriptor)
    return path
