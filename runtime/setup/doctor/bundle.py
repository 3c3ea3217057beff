"""Archive for a bug report: the end of a recording, and the computer, without data about persons.

    recording.json      metadata, and what is wrong with the file
    events.json         events; marks without their notes
    signals.csv         every signal of the last seconds
    frames.can.log      the CAN frames of these seconds, as candump writes them
    diagram.json        blocks, parameters, connections
    rig.toml            the rig file without comments
    records.toml        the records of commissioning beside the rig file, without their signatures
    computer.json       versions, findings of `doctor`, such as throttling, and temperatures
    kernel.log          the newest lines of the kernel

A member that cannot be made is left out, with the reason in problems.txt: a damaged recording is when it is needed.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from runtime.host.errors import BadInput
from runtime.host.machine.finding import Wants
from runtime.host.machine.probe import Machine
from runtime.host.machine.thermal import thermal
from runtime.record.analysis.trial import Trial
from runtime.record.export import candump, csv
from runtime.record.storage.provenance import versions
from runtime.robot.rig.records import digest, folder_of, of_text
from runtime.setup.doctor import examine
from runtime.setup.doctor.persons import Persons

LAST = 10.0  # s of the end of a recording
KERNEL_LINES = 400


class Bundle:
    """Contents of an archive.

    path : path of a .mcap file, which may be damaged
    seconds : s of the end of the recording

    members : {name: content}; problems : reasons why a member is missing; persons : Persons, whose names are removed
    """

    def __init__(self, path: Path, seconds: float = LAST, machine: Machine | None = None) -> None:
        self.path, self.seconds, self.machine = path, seconds, machine or Machine()
        self.members: dict[str, str] = {}
        self.problems: list[str] = []
        self.trial: Trial | None = None
        self.about = self._about()
        self.persons = Persons(self.about, self._names())
        for name, make in self._makers().items():
            try:
                content = make()
            except Exception as error:  # the archive is for what is out of order
                self._problem(f"{name}: {type(error).__name__}: {error}")
                continue
            if content:
                self.members[name] = content
        if self.problems:
            self.members["problems.txt"] = self.persons.scrub("\n".join(self.problems) + "\n")

    def _problem(self, text: str) -> None:
        """Note a problem without the name of the recording, which has the fields of its trial."""
        for ending in (".mcap", ".json"):
            text = text.replace(str(self.path.with_suffix(ending)), f"recording{ending}")
        self.problems.append(text)

    def _names(self) -> Iterator[str]:
        """Yield the names of the diagram: of itself, its buses, its signals and its blocks."""
        yield from (self.about.get("name") or "", *(self.about.get("buses") or ()))
        if self.trial is not None:
            yield from self.trial.signals
            yield from (block["path"] for block in (self.trial.diagram or {}).get("blocks", ()))

    def _about(self) -> dict[str, Any]:
        """Return the metadata of the recording, or of the .json file beside it. Raises BadInput if there is nothing."""
        if not self.path.is_file():
            raise BadInput(f"--bundle {self.path}: no such file: name the .mcap file of a recording")
        if self.path.suffix != ".mcap":
            raise BadInput(f"--bundle {self.path}: name the .mcap file of a recording")
        try:
            self.trial = Trial(self.path)
            return self.trial.about
        except BadInput as error:
            self._problem(str(error))
        with suppress(OSError, ValueError):
            about = json.loads(self.path.with_suffix(".json").read_text())
            if isinstance(about, dict) and isinstance(about.get("metadata"), dict):
                return about
        return {}

    def _makers(self) -> dict[str, Callable[[], str]]:
        """Return {name of a member: function that makes it}."""
        return {
            "recording.json": lambda: self._json(self.persons.without_fields(self._recording())),
            "events.json": lambda: self._json(self.persons.without_fields({"events": self._trial().events})["events"]),
            "signals.csv": lambda: self._exported(csv.write),
            "frames.can.log": lambda: self._exported(candump.write) if candump.on_can(self._trial().about) else "",
            "diagram.json": lambda: self._json(self._trial().diagram) if self._trial().diagram else "",
            "rig.toml": self._rig,
            "records.toml": self._records,
            "computer.json": lambda: self._json(computer(self.machine)),
            "kernel.log": lambda: self.persons.scrub(kernel_log(self.machine)),
        }

    def _json(self, value: Any) -> str:
        """Return a value as indented JSON, without names of persons."""
        return json.dumps(self.persons.scrubbed(value), indent=1, ensure_ascii=False, default=str) + "\n"

    def _trial(self) -> Trial:
        if self.trial is None:
            raise ValueError("the recording cannot be read")
        return self.trial

    def _recording(self) -> dict[str, Any]:
        end = {} if self.trial is None else {"end": self.trial.end, "trouble": self.trial.trouble}
        return {**self.about, **end}

    def _exported(self, write: Callable[[Any, str, Callable[[float], None]], None]) -> str:
        """Return what a format of `convert` writes for the last seconds."""
        trial = self._trial()
        times = trial.time
        if not len(times):
            return ""
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "part")
            write(trial.between(times[-1] - self.seconds, times[-1] + 1.0), path, lambda share: None)
            return Path(path).read_text()

    def _rig(self) -> str:
        rig = (self.about.get("metadata") or {}).get("rig") or {}
        return self.persons.scrub(self.persons.without_comments(rig.get("text", ""), "rig.toml"))

    def _records(self) -> str:
        rig = (self.about.get("metadata") or {}).get("rig") or {}
        known = rig.get("records") or {}
        folders = (Path(), *self.path.resolve().parents[:3]) if rig else ()
        folder = next((found for each in folders if (found := folder_of(each / rig["file"])).is_dir()), None)
        if folder is None:
            if known.get("serials"):
                raise BadInput(f"no folder {folder_of(rig['file'])}: run the command in the folder of the run")
            return ""
        read, texts = {}, []
        for path in sorted(folder.glob("*.toml")):
            try:
                record = of_text(path.read_text(encoding="utf-8"), path)
            except (BadInput, OSError, UnicodeDecodeError) as error:
                self._problem(f"records.toml: {path.name}: {error}")
                continue
            if known.get("serials", {}).get(record.device) == record.serial:
                read[record.device] = record
            texts.append(f"# {path.name}\n{replace(record, signed={}).text()}")
        if known.get("serials") and digest(read) != known.get("sha256"):
            texts.insert(0, "# CHANGED since the run: these are not the records that it has read\n")
        self.persons.removed += ["records.toml: signed, comments"] * bool(texts)
        return self.persons.scrub("\n".join(texts))

    def listing(self) -> list[str]:
        """Return lines on every member, and on what was removed."""
        width = max(map(len, self.members))
        lines = [f"  {name:<{width}}  {len(text.encode()):>9,} bytes" for name, text in self.members.items()]
        lines += [f"left out: {problem}" for problem in self.problems]
        everywhere = "in every text: names of computers and accounts, paths of homes, values of these fields"
        lines += [f"removed: {'; '.join(filter(None, [', '.join(self.persons.removed), everywhere]))}"]
        if "signals.csv" in self.members:
            lines.append("the signals of a wearer are personal data: ask the wearer before you publish the archive")
        return lines

    def write(self, path: Path) -> Path:
        """Write the archive under this name, or under one with a number if that is taken. Returns the path.

        Raises BadInput if the folder takes no file.
        """
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                    for name, text in self.members.items():
                        archive.writestr(name, text)
                file.flush()
                os.fsync(file.fileno())
            return move(part, path)
        except OSError as error:
            raise BadInput(
                f"cannot write {path}: {error.strerror or error}; run the command in another folder"
            ) from None
        finally:
            with suppress(OSError):
                part.unlink()

    def name(self) -> str:
        """Return the name of the archive: the diagram and the time of the run, without the fields of its trial."""
        [*_, began] = re.findall(r"\d{4}-\d\d-\d\d_\d\d-\d\d-\d\d", self.path.stem) or [""]
        words = [re.sub(r"[^\w.-]+", "-", self.about.get("name") or "recording"), began, "bundle.zip"]
        return "_".join(filter(None, words))


def move(part: Path, path: Path) -> Path:
    """Rename a file to a name that no file has: with -2, -3 before its ending. Returns it."""
    for wanted in numbered(path):
        try:
            os.link(part, wanted)  # fails if there is one
        except FileExistsError:
            continue
        except OSError:  # FAT has no links
            if wanted.exists():
                continue
            os.rename(part, wanted)
        return wanted
    raise AssertionError


def numbered(path: Path) -> Iterator[Path]:
    """Yield a path, and it with -2, -3 before its ending."""
    yield path
    number = 2
    while True:
        yield path.with_stem(f"{path.stem}-{number}")
        number += 1


def computer(machine: Machine) -> dict[str, Any]:
    """Return versions, findings of `doctor` and the thermal state of a machine."""
    return {
        "model": machine.model,
        "system": machine.system,
        "kernel": machine.kernel,
        "versions": versions(),
        "thermal": thermal(machine),
        "findings": [asdict(finding) for finding in examine(machine, Wants())],
    }


def kernel_log(machine: Machine) -> str:
    """Return the newest lines of the kernel; why there are none, if they may not be read."""
    text = machine.output("dmesg", "--time-format", "iso") or machine.output("journalctl", "-k")
    lines = text.splitlines()[-KERNEL_LINES:] or ["not readable: run the command with sudo, or join the group adm"]
    return "\n".join(lines) + "\n"
