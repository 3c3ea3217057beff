"""The diagram that a replay runs: a file, the recorded file if it is unchanged, or the diagram in the recording."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blocks.recorders import CsvRecorder
from graph import DiagramError, Sink
from graph.store import from_json
from runtime.host.errors import BadInput
from runtime.robot.loading.file import load
from runtime.robot.loading.subject import of_recording
from runtime.robot.rig.file import parse

if TYPE_CHECKING:
    from graph import Diagram
    from runtime.record.analysis.trial import Trial
    from runtime.robot.loading.subject import Subject

READ_SIZE = 1 << 20  # bytes
VIEWERS = ("Lsl", "Panel", "PlotJuggler", "Rerun", "Ros2")
SINKS = ("blocks.recorders:CsvRecorder", *(f"blocks.sinks:{name}" for name in VIEWERS))


@dataclass(frozen=True)
class Source:
    """Source of the diagram to run.

    file : Path of a Python file; None for the diagram in the recording, which runs code of installed libraries only
    sha256 : hex digest that the content of `file` must have; None for any content, if the operator has named the file
    instead : reason why the diagram in the recording is used instead of the recorded file
    """

    file: Path | None
    sha256: str | None = None
    instead: str = ""


def source_of(trial: Trial, file: str | Path | None = None) -> Source:
    """Return the Source of the diagram to run.

    Loading a diagram file runs its code, and a recording can come from an untrusted source. A file named by the
    recording alone is therefore loaded only if its content has the recorded hash.

    file : a diagram file that the operator has named
    """
    if file is not None:
        return Source(Path(file))
    metadata = trial.about["metadata"]
    recorded, sha256 = str(metadata.get("diagram_file") or ""), metadata.get("source_sha256")
    if not os.path.isfile(recorded):
        return Source(None, instead=f"{recorded or 'its diagram file'} does not exist")
    if not sha256:
        return Source(None, instead=f"the recording has no hash of {recorded}")
    if sha256_of(recorded) != sha256:
        return Source(None, instead=f"{recorded} has changed since the recording")
    return Source(Path(recorded), sha256)


def sha256_of(path: str | Path) -> str:
    """Return the hex digest of a file's content; "" if it cannot be read."""
    try:
        with open(path, "rb") as stream:
            digest = hashlib.sha256()
            while data := stream.read(READ_SIZE):
                digest.update(data)
    except OSError:
        return ""
    return digest.hexdigest()


def diagram_of(trial: Trial, source: Source) -> tuple[Diagram, Path, dict[str, Any]]:
    """Return (Diagram, path of its source, metadata of the source for the new recording). Raises BadInput."""
    metadata = trial.about["metadata"]
    if source.file is None:
        diagram, where, origin = stored_diagram(trial, source), trial.path, {}
    else:
        rig, settings = metadata.get("rig"), list(metadata.get("settings", {}).items())
        rig_file = rig and parse(Path(rig["file"]), rig["text"])
        file, diagram = load(source.file, settings, rig_file, source.sha256, subject_of(trial))
        where, origin = source.file, {"diagram_file": str(source.file), "source_sha256": file.sha256}
    diagram.rate = trial.about["rate"]
    return diagram, where, origin


def subject_of(trial: Trial) -> Subject | None:
    """Return the Subject of a recorded run, None without one."""
    entry = trial.about["metadata"].get("subject")
    return None if entry is None else of_recording(entry)


def stored_diagram(trial: Trial, source: Source) -> Diagram:
    """Return the diagram that is stored in a recording. Raises BadInput."""
    remedy = "run a diagram file with --diagram FILE"
    if trial.diagram is None:
        raise BadInput(f"{trial.path}: {source.instead}, and the recording contains no diagram: {remedy}")
    try:
        diagram, subject = from_json(json.dumps(trial.diagram)), subject_of(trial)
        if subject is not None:
            diagram.caps = subject.caps(diagram)
        return diagram
    except DiagramError as error:
        raise BadInput(
            f"{trial.path}: {source.instead}, and the diagram in the recording cannot be used: {error}\n{remedy}"
        ) from None
    except (LookupError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{trial.path} is damaged: its diagram.json is not a diagram ({error!r}); {remedy}") from None


def add_recorder(trial: Trial, diagram: Diagram) -> None:
    """Add a recorder if `--record` had added one, or if the diagram has no sink."""
    description: Any = trial.diagram or {}
    recorded = any(block["type"].endswith(":CsvRecorder") for block in description.get("blocks", []))
    if not any(isinstance(block, CsvRecorder) if recorded else isinstance(block, Sink) for block in diagram):
        with diagram:
            CsvRecorder()


def computation(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description of a diagram without its sinks, which options of a run can add."""
    sinks = {block["path"] for block in description.get("blocks", []) if block["type"] in SINKS}
    return {key: value for key, value in description.items() if key not in ("hash", "blocks", "wires", "libraries")} | {
        "blocks": [block for block in description.get("blocks", []) if block["path"] not in sinks],
        "wires": [wire for wire in description.get("wires", []) if wire["to"] not in sinks],
    }
