"""Conversion of recordings to other formats: every sample of every signal, exact if the format has doubles.

mcap        complete, with an index, in one file
csv         as the recorder writes it
parquet     one column a number, in its type, with units as metadata
mat         MATLAB: a nested struct with units and time
rrd         Rerun, with a blueprint from the recording
sto, mot    OpenSim: all signals; joint angles
candump     the frames of the CAN buses, as the recorder's CAN log has them, in a .can.log file

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
        "candump": "runtime.export.candump",
    },
)
OPENSIM = ("sto", "mot")
EXTENSIONS = {"candump": "can.log"}  # of formats that are not their own


def convert(trial, kind, stem, progress=lambda share: None):
    """Write a Trial as `stem` with the extension of its kind, numbered if that exists. Returns the path.

    The file is renamed after it is complete, so that a file with this name has every sample, even after a power loss.

    progress : called with the fraction that is done

    Raises BadInput, MissingExtra or OSError, with nothing left behind.
    """
    module = FORMATS.load(kind)
    trial.check()
    module.check(trial, kind)
    extension = EXTENSIONS.get(kind, kind)
    path = part = reserved(stem, extension)
    try:
        part = reserved(f"{path.removesuffix(f'.{extension}')}.part", extension)
        module.write(trial, part, progress)
        os.replace(part, path)
    except BaseException:
        for made in {part, path}:
            with suppress(FileNotFoundError):
                os.unlink(made)
        raise
    return path


def reserved(stem, extension):
    """Create an empty file under an unused path, and return the path."""
    path, descriptor = create(stem, f".{extension}")
    os.close(descriptor)
    return path
