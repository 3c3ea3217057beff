"""Records of commissioning: what was measured on each device of a rig, one readable file per serial number.

    lab.toml                        the rig
    lab.records/4F2A10C3.toml       one device, found by `commission`, signed by name and date

    version = 1
    serial = "4F2A10C3"
    device = "left/knee"            path of its block when it was measured
    block = "DriveBlock"
    model = "D80"
    firmware = "0.2.3.22"
    about = { computer = "Raspberry Pi 5, Debian 13", adapter = "socketcan, 1000 kbit/s", tickwork = "1.2.0" }
    settings = { can_id = 3, invert = true }            hardware parameters that the measurements rest on
    signed = { name = "E. Person", date = "2026-12-01" }

    [step.turn]
    when = "2026-12-01 14:02"
    verdict = "agrees"              or "differs", "not measured"
    measured = { turned = 1.571 }   in the units of `says`
    says = ["..."]
    findings = [["direction", "..."]]                   name of a fault, and what was found

`records_of` returns the records of a rig, `Record.mismatches` why one does not apply to a block, `digest` one hash of
all.
"""

from __future__ import annotations

import datetime
import json
import re
import sys
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graph import Actuator, Device
from runtime.host import replaced_file
from runtime.host.errors import BadInput

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from collections.abc import Mapping

    from graph import Diagram

VERSION = 1
FRESH = 180  # days
SHOWN_WITHIN = 0.25  # s, of a silence beyond a time-out: in which a lever shows that the drive has stopped
AGREES, DIFFERS, OPEN = "agrees", "differs", "not measured"
BEFORE_TORQUE = ("identity", "bus", "state", "turn")  # steps that must agree before a motor is enabled
OF_SENSORS = ("rest", "bend")  # steps that must agree before a sensor is worn


@dataclass
class StepRecord:
    """Result of one step.

    when : date and time; verdict : AGREES, DIFFERS or OPEN
    measured : {name: number}; says : lines for the operator; findings : (name of a fault, text)
    """

    when: str
    verdict: str
    measured: dict[str, float] = field(default_factory=dict)
    says: list[str] = field(default_factory=list)
    findings: list[tuple[str, str]] = field(default_factory=list)


@dataclass
class Record:
    """Record of one device; the module describes its file. steps : {name: StepRecord}"""

    serial: str
    device: str
    block: str
    model: str
    firmware: str = ""
    about: dict[str, str] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    signed: dict[str, str] = field(default_factory=dict)
    steps: dict[str, StepRecord] = field(default_factory=dict)

    @property
    def findings(self) -> list[tuple[str, str]]:
        """Findings of every step: (name of a fault, text)."""
        return [finding for step in self.steps.values() for finding in step.findings]

    def text(self) -> str:
        """Return the content of its file."""
        lines = ["# Written by the command `commission`", f"version = {VERSION}"]
        own = {name: value for name, value in asdict(self).items() if name != "steps"}
        lines += [f"{name} = {toml(value)}" for name, value in own.items()]
        for name, step in self.steps.items():
            lines += ["", f"[step.{name}]", *(f"{key} = {toml(value)}" for key, value in asdict(step).items())]
        return "\n".join([*lines, ""])

    def mismatches(self, block: Device, today: datetime.date | None = None) -> list[str]:
        """Return the reasons why this record does not apply to a block with the parameters of its rig."""
        found = []
        if self.device != block.path:
            found.append(f"was measured at {self.device}")
        if self.block != type(block).__name__ or self.model != getattr(block, "model", ""):
            found.append(f"is of a {self.block} {self.model}".rstrip())
        found += [
            f"was measured with {name} = {toml(value)}"
            for name, value in self.settings.items()
            if name in block.parameters and plain(getattr(block, name)) != value
        ]
        now = settings_of(block)
        found += [
            f"was measured without {name} = {toml(now[name])}"
            for name in now.keys() - self.settings.keys() - {"range", "drive_timeout", "reference"}
            if now[name] != plain(block.parameters[name].default)
        ]
        age = ((today or datetime.date.today()) - datetime.date.fromisoformat(self.signed["date"])).days
        return [*found, *[f"is {age} days old"] * (age > FRESH)]

    def differences(self, serial: str, firmware: str) -> list[str]:
        """Return how the unit that responds differs from this record. firmware : "" if it reports none"""
        if serial != self.serial:
            return [f"is of the unit {self.serial}, and the unit that responds is {serial}, which has no record"]
        if firmware != self.firmware:
            return [f"is of firmware {self.firmware or 'unknown'}, and the unit has {firmware or 'reported none'}"]
        return []

    def faults(self, block: Device) -> list[str]:
        """Return its findings as text, and the steps without one that a worn robot needs."""
        needed = BEFORE_TORQUE if isinstance(block, Actuator) else OF_SENSORS
        left = [name for name in needed if name not in self.steps or self.steps[name].verdict == OPEN]
        own, silence = getattr(block, "drive_timeout", None), self.steps.get("silence")
        seen = {} if silence is None else silence.measured
        if own is not None and not (seen.get("stopped") and seen["silence"] < own + SHOWN_WITHIN):
            left.append(f"silence that shows drive_timeout = {own:g}")
        return [*[f"has no {', '.join(left)}"] * bool(left), *(f"found: {text}" for _, text in self.findings)]


def of_text(text: str, path: Path) -> Record:
    """Return the Record of a file's text. Raises BadInput. path : file named in messages"""
    try:
        content = tomllib.loads(text)
        if content.pop("version") != VERSION:
            raise ValueError(f"only version {VERSION} can be read")
        steps = {name: StepRecord(**step) for name, step in content.pop("step", {}).items()}
        record = Record(**content, steps=steps)
        datetime.date.fromisoformat(record.signed["date"])
    except (ValueError, TypeError, KeyError) as error:
        raise BadInput(f"{path} is not a record of `commission`: {error}; move it away and commission again") from None
    return record


def folder_of(rig: str | Path) -> Path:
    """Return the folder of the records of a rig file."""
    return Path(rig).with_suffix(".records")


def recorded_devices(diagram: Diagram) -> list[Device]:
    """Return the blocks that are commissioned: actuators and inertial sensors."""
    devices = [block for block in diagram if isinstance(block, Device)]
    return [block for block in devices if isinstance(block, Actuator) or {"accel", "gyro"} <= set(block.outputs)]


def records_of(rig: str | Path) -> dict[str, Record]:
    """Return {path of a block: its Record} of a rig file; the newest where a path has several. Raises BadInput."""
    return {record.device: record for record in every_record(rig)}


def every_record(rig: str | Path) -> list[Record]:
    """Return the Records of a rig file, the newest last. Raises BadInput."""
    paths = sorted(folder_of(rig).glob("*.toml"))
    return sorted(
        (of_text(path.read_text(encoding="utf-8"), path) for path in paths), key=lambda each: each.signed["date"]
    )


def file_of(rig: str | Path, record: Record) -> Path:
    """Return the path of a record's file."""
    return folder_of(rig) / f"{re.sub(r'[^A-Za-z0-9._-]', '_', record.serial)}.toml"


def digest(records: Mapping[str, Record]) -> str:
    """Return the SHA-256 in hexadecimal of all records, independent of their order."""
    return sha256("".join(records[path].text() for path in sorted(records)).encode()).hexdigest()


def write(rig: str | Path, record: Record) -> Path:
    """Write a record beside its rig file, in place of that of the same serial number. Returns its path."""
    path = file_of(rig, record)
    try:
        path.parent.mkdir(exist_ok=True)
        replaced_file.write(path, record.text())
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}") from None
    return path


def settings_of(block: Device) -> dict[str, Any]:
    """Return the hardware parameters of a block on which its measurements rest, if they are set."""
    values = {name: plain(getattr(block, name)) for name in block.hardware if name in block.parameters}
    return {name: value for name, value in values.items() if value not in (None, "", [])}


def plain(value: Any) -> Any:
    """Return a parameter as TOML has it."""
    return list(value) if isinstance(value, tuple) else value


def toml(value: Any) -> str:
    """Return a value in TOML notation."""
    if isinstance(value, dict):
        entries = ", ".join(f"{key} = {toml(each)}" for key, each in value.items())
        return f"{{ {entries} }}" if entries else "{}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml, value)) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str) else repr(value)
