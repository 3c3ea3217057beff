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

import getpass
import json
import os
import platform
import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.host.errors import BadInput
from runtime.host.machine.finding import Wants
from runtime.host.machine.probe import Machine
from runtime.host.machine.thermal import thermal
from runtime.record.analysis.trial import Trial
from runtime.record.export import candump, csv
from runtime.record.storage.provenance import versions
from runtime.setup.doctor import examine

if TYPE_CHECKING:
    pass

LAST = 10.0  # s of the end of a recording
KERNEL_LINES = 400
PERSONAL = ("trial", "subject", "notes", "note", "operator", "node", "folder", "text")  # keys that are removed
OTHERS = "REMOVED"
SHORTEST = 3  # characters of a value that is looked for in other texts
HOMES = re.compile(r"/(?:home|Users)/[^/\s\"':,;)]+")


class Bundle:
    """Contents of an archive.

    path : path of a .mcap file, which may be damaged
    seconds : s of the end of the recording

    members : {name: content}; problems : reasons why a member is missing; removed : what was removed, as text
    """

    def __init__(self, path: Path, seconds: float = LAST, machine: Machine | None = None) -> None:
        self.path, self.seconds, self.machine = path, seconds, machine or Machine()
        self.members: dict[str, str] = {}
        self.problems: list[str] = []
        self.removed: list[str] = []
        self.trial: Trial | None = None
        self.about = self._about()
        self.words = self._words()
        for name, make in self._makers().items():
            try:
                content = make()
            except Exception as error:  # the archive is for what is out of order
                self.problems.append(f"{name}: {type(error).__name__}: {error}")
                continue
            if content:
                self.members[name] = self.scrub(content)
        if self.problems:
            self.members["problems.txt"] = self.scrub("\n".join(self.problems) + "\n")

    def _about(self) -> dict[str, Any]:
        """Return the metadata of the recording, or of the .json file beside it. Raises BadInput if there is nothing."""
        if not self.path.is_file():
            raise BadInput(f"--bundle {self.path}: no such file: name the .mcap file of a recording")
        try:
            self.trial = Trial(self.path)
            return self.trial.about
        except BadInput as error:
            self.problems.append(str(error))
        with suppress(OSError, ValueError):
            return json.loads(self.path.with_suffix(".json").read_text())
        return {}

    def _words(self) -> dict[str, str]:
        """Return {name of the wearer, the operator or the computer: its replacement}, for every member."""
        metadata = self.about.get("metadata") or {}
        fields = {**(metadata.get("trial") or {}), "id": (metadata.get("subject") or {}).get("id")}
        values = [str(value) for value in fields.values() if value]
        in_names = [re.sub(r"[^\w.-]+", "-", value) for value in values]  # of files
        words = {value: OTHERS for value in (*values, *in_names) if len(value) >= SHORTEST}
        hosts = {platform.node(), str((self.about.get("machine") or {}).get("node") or "")} - {"", "localhost"}
        words |= dict.fromkeys(hosts, "HOST")
        with suppress(KeyError, OSError):  # an account without a name
            users = {getpass.getuser(), os.environ.get("SUDO_USER") or "root"} - {"root"}
            words |= {user: "USER" for user in users if len(user) >= SHORTEST}
        return words

    def scrub(self, text: str) -> str:
        """Return a text without names of persons, computers and homes."""
        home = os.path.expanduser("~")
        if len(home) > 1:
            text = text.replace(home + "/", "~/")
        text = HOMES.sub("~", text)
        for word, instead in sorted(self.words.items(), key=lambda item: -len(item[0])):
            text = re.sub(rf"(?<![A-Za-z0-9]){re.escape(word)}(?![A-Za-z0-9])", instead, text)
        return text

    def plain(self, value: Any, where: str = "") -> Any:
        """Return a value of JSON without the keys that are about persons, each of which is noted."""
        if isinstance(value, Mapping):
            kept = {}
            for key, each in value.items():
                place = f"{where}.{key}".lstrip(".")
                if key in PERSONAL and isinstance(each, (str, Mapping)) and each:
                    if key == "subject" and isinstance(each, Mapping):  # the limits of a subject file stay
                        each = {name: part for name, part in each.items() if name not in ("id", "file")}
                        kept[key], place = each, f"{place}.id"
                    self.removed += [place] * (place not in self.removed)
                else:
                    kept[key] = self.plain(each, place)
            return kept
        return [self.plain(each, where) for each in value] if isinstance(value, list) else value

    def _makers(self) -> dict[str, Callable[[], str]]:
        """Return {name of a member: function that makes it}."""
        return {
            "recording.json": lambda: as_json(self.plain(self._recording())),
            "events.json": lambda: as_json(self.plain({"events": self._trial().events})["events"]),
            "signals.csv": lambda: self._exported(csv.write),
            "frames.can.log": lambda: self._exported(candump.write) if candump.on_can(self.about) else "",
            "diagram.json": lambda: as_json(self._trial().diagram) if self._trial().diagram else "",
            "rig.toml": self._rig,
            "records.toml": self._records,
            "computer.json": lambda: as_json(computer(self.machine)),
            "kernel.log": lambda: kernel_log(self.machine),
        }

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
        lines = [re.sub(r"\s*#[^\"']*$", "", line) for line in rig.get("text", "").splitlines()]
        self.removed += ["rig.toml: comments"] * (lines != rig.get("text", "").splitlines())
        return "".join(f"{line}\n" for line in lines)

    def _records(self) -> str:
        rig = ((self.about.get("metadata") or {}).get("rig") or {}).get("file")
        paths = [] if rig is None else sorted(Path(rig).with_suffix(".records").glob("*.toml"))
        self.removed += ["records.toml: signed"] * bool(paths)
        signed = re.compile(r"^signed\b.*$", re.MULTILINE)
        return "\n".join(f"# {path.name}\n{signed.sub('', path.read_text())}" for path in paths)

    def listing(self) -> list[str]:
        """Return lines on every member, and on what was removed."""
        width = max(map(len, self.members))
        lines = [f"  {name:<{width}}  {len(text.encode()):>9,} bytes" for name, text in self.members.items()]
        lines += [f"left out: {problem}" for problem in self.problems]
        everywhere = "in every text: names of computers and accounts, paths of homes, values of these fields"
        lines += [f"removed: {'; '.join([', '.join(self.removed), everywhere])}"]
        if "signals.csv" in self.members:
            lines.append("the signals of a wearer are personal data: ask the wearer before you publish the archive")
        return lines

    def write(self, path: Path) -> Path:
        """Write the archive under this name, or under one with a number if that is taken. Returns the path."""
        part = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            with os.fdopen(os.open(part, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
                with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
                    for name, text in self.members.items():
                        archive.writestr(name, text)
                file.flush()
                os.fsync(file.fileno())
            return move(part, path)
        finally:
            part.unlink(missing_ok=True)

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


def as_json(value: Any) -> str:
    """Return a value as indented JSON."""
    return json.dumps(value, indent=1, ensure_ascii=False, default=str) + "\n"


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
