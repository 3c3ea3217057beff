"""Conversion of recordings to other formats: every sample of every signal, exact if the format has doubles.

mcap        complete, with an index, in one file
csv         as the recorder writes it
parquet     one column per number, in its type, with units as metadata
mat         MATLAB: a nested struct with units and time
rrd         Rerun, with a blueprint from the recording
xdf         two streams, as LabRecorder writes them
sto, mot    OpenSim: all signals; joint angles
candump     the frames of the CAN buses, as the recorder's CAN log has them, in a .can.log file

An installed package adds a format in the entry-point group "tickwork.formats", under its file name extension:

    [project.entry-points."tickwork.formats"]
    h5 = "mylab.hdf5"

A module of this package lists its formats with the extensions of their files, EXTENSIONS = {"mat": "mat"}. Every
module has two functions:

    check(trial, kind)              raises BadInput or MissingExtra for a Trial that the format cannot hold
    write(trial, path, progress)    writes the file; `progress` is called with the fraction that is done, 0 to 1
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module

from runtime.host.plugins import Plugins, modules_of
from runtime.record.analysis.trial import Trial
from runtime.record.storage.files import create

MODULES = [import_module(module) for module in modules_of(__name__).values()]
EXTENSIONS = {kind: extension for module in MODULES for kind, extension in module.EXTENSIONS.items()}
FORMATS = Plugins("tickwork.formats", {kind: module.__name__ for module in MODULES for kind in module.EXTENSIONS})
OPENSIM = ("sto", "mot")


def convert(trial: Trial, kind: str, stem: str, progress: Callable[[float], None] = lambda share: None) -> str:
    """Write a Trial to a file and return its path.

    The file is renamed after it is complete, so that a file with this name has every sample, even after a power loss.

    kind : a format, from FORMATS
    stem : path without the extension; a number is appended if the file exists
    progress : called with the fraction that is done

    Raises BadInput, MissingExtra or OSError. No file remains then.
    """
    module = FORMATS.load(kind)
    trial.check()
    module.check(trial, kind)
    extension = EXTENSIONS.get(kind, kind)
    path = part = reserve_path(stem, extension)
    try:
        part = reserve_path(f"{path.removesuffix(f'.{extension}')}.part", extension)
        module.write(trial, part, progress)
        os.replace(part, path)
    except BaseException:
        for made in {part, path}:
            with suppress(FileNotFoundError):
                os.unlink(made)
        raise
    return path


def reserve_path(stem: str, extension: str) -> str:
    """Create an empty file under an unused path, and return the path."""
    path, descriptor = create(stem, f".{extension}")
    os.close(descriptor)
    return path
