"""Subject files: limits for one person, which a principal investigator signs. Nothing in a run raises them.

    version = 1
    id = "S03"                          # recorded; not a name
    signed_by = "A. Investigator"       # not recorded, nor is the reason
    date = 2026-11-27
    reason = "first session, protocol 12"

    [session]
    duration = "30 min"

    [joint."*/knee"]                    # an actuator of the diagram, or several
    torque = 8.0                        # N·m at the joint
    range = ["-5 deg", "90 deg"]
    speed = 4.0                         # rad/s
    power = 60.0                        # W, driving or braking

    [assistance]
    "*/profile.scale" = 0.6             # largest magnitude of a parameter

Every limit is the smaller of the diagram's and the file's. graph.compile applies the caps of the actuators to what it
hands to native code, whatever the blocks return; the limits of parameters hold for their live changes too.
"""

from __future__ import annotations

import datetime
import inspect
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Any

from msgspec.structs import asdict
from msgspec.structs import replace as changed

from cext.user_files import read_small
from graph import Caps, DiagramError
from graph.declarations import LiveBounds
from graph.device import actuators_of
from graph.sha256 import sha256
from graph.units import parse_quantity
from runtime.host.errors import BadInput
from runtime.host.live import patterns
from runtime.host.suggestions import suggestion
from runtime.robot.loading.overrides import places_of

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from graph import Diagram

VERSION = 1
FADE_OUT = 2.0  # s, over which commands decrease to zero before the end of a session
SIGNATURE = {"id": "S03", "signed_by": "A. Investigator", "date": "2026-11-27", "reason": "first session"}
UNITS = {"torque": "N·m", "range": "rad", "speed": "rad/s", "power": "W"}  # of a joint
TURN = 2.0 * math.pi  # rad; a larger angle of a joint is probably in degrees


@dataclass(frozen=True)
class Subject:
    """Content of a subject file, without the names of persons.

    file : path, for messages; sha256 : hex digest of its content
    joints : {path or pattern: graph.Caps}; assistance : {name or pattern of a parameter: largest magnitude}
    duration : s, of a run; None without a limit
    signed_by : name, which is shown and not recorded
    """

    file: str
    sha256: str
    id: str
    date: str
    joints: dict[str, Caps]
    assistance: dict[str, float]
    duration: float | None
    signed_by: str = field(default="", compare=False)

    @property
    def name(self) -> str:
        """Text that names it in messages."""
        return f"subject {self.id} ({Path(self.file).name})"

    def recorded(self) -> dict[str, Any]:
        """Return the part that a recording carries, as plain data, without names."""
        return {
            "id": self.id,
            "date": self.date,
            "file": Path(self.file).name,
            "sha256": self.sha256,
            "joints": {
                name: {key: value for key, value in asdict(caps).items() if key in UNITS and not is_none(value)}
                for name, caps in self.joints.items()
            },
            "assistance": self.assistance,
            "duration": self.duration,
        }

    def ticks(self, rate: float, ticks: int) -> int:
        """Return the smaller of the grid points of a run, -1 until stopped, and those of the session. rate : Hz"""
        most = -1 if self.duration is None else max(1, int(self.duration * rate))
        return most if ticks < 0 or 0 <= most < ticks else ticks

    def ramp(self, rate: float) -> dict[str, Any]:
        """Return the options of an Executor that end the session with a ramp, {} without a duration."""
        if self.duration is None:
            return {}
        return {"fade_out": min(FADE_OUT, 0.5 * self.duration), "ends_at": self.ticks(rate, -1)}

    def settings(self, build: Callable[..., Any] | None, given: Iterable[tuple[str, Any]]) -> list[tuple[str, Any]]:
        """Return settings that keep parameters of `build` within `assistance`. given : settings of the run"""
        known = {} if build is None else dict(inspect.signature(build).parameters)
        lowered = []
        for name, most in self.assistance.items():
            if "." in name:
                continue
            if name not in known:
                hint = suggestion(name, known) or "write BLOCK.PARAMETER for one of a block"
                raise BadInput(f"{self.file}: [assistance] {name}: build() has no such parameter; {hint}")
            value = next((value for key, value in reversed([*given]) if key == name), known[name].default)
            lowered += [(name, min(max(self.number(name, value), -most), most))]
        return lowered

    def number(self, name: str, value: Any) -> float:
        """Return the value of a parameter, or its text, as a number. Raises BadInput."""
        try:
            number = parse_quantity(value, None) if isinstance(value, str) else float(value)
        except (TypeError, ValueError):
            number = math.nan
        if not math.isfinite(number):
            raise BadInput(f"{self.file}: [assistance] {name} is {value!r}, which is not a finite number")
        return number

    def apply(self, diagram: Diagram) -> Callable[[], object]:
        """Put the limits above those of a diagram, after its settings. Returns a function that undoes it.

        Raises BadInput for a joint or a parameter that the diagram does not have.
        """
        undo, blocks = ExitStack(), dict[Any, None]()
        undo.callback(self.reconfigure, blocks)
        undo.callback(setattr, diagram, "caps", diagram.caps)
        diagram.caps = self.caps(diagram)
        for path, caps in diagram.caps.items():
            self.narrow(diagram[path], caps, undo)
            blocks[diagram[path]] = None
        for name, most in self.assistance.items():
            for block, parameter in self.places(diagram, name) if "." in name else ():
                self.lower(block, parameter, most, undo)
                blocks[block] = None
        self.reconfigure(blocks)
        return undo.close

    def places(self, diagram: Diagram, name: str) -> list[tuple[Any, str]]:
        """Return (block, parameter) of an entry of `assistance`. Raises BadInput without one."""
        try:
            return places_of(diagram, name, "")
        except BadInput as error:
            raise BadInput(f"{self.file}: [assistance] {name}: {str(error).partition(': ')[2]}") from None

    def caps(self, diagram: Diagram) -> dict[str, Caps]:
        """Return {path: Caps} of the actuators of a diagram: of several that match, the smallest of each quantity."""
        paths = [block.path for block in actuators_of(diagram)]
        found: dict[str, Caps] = {}
        for name, caps in self.joints.items():
            matching = patterns.matching(name, paths)
            if not matching:
                hint = patterns.hint(name, paths)
                raise BadInput(
                    f'{self.file}: [joint."{name}"]: {diagram.name} has no such actuator; {f"{hint}; " * bool(hint)}'
                    f"its joints are {', '.join(paths) or 'none'}"
                )
            for path in matching:
                found[path] = self.smaller(found[path], caps) if path in found else caps
        return found

    def for_any_joint(self) -> Subject:
        """Return the Subject of one actuator that may be at any joint: the smallest of all caps.

        Raises BadInput for a range, which needs the zero and the direction of a joint.
        """
        if ranges := [name for name, caps in self.joints.items() if caps.range]:
            raise BadInput(
                f"{self.file}: the range of {', '.join(ranges)} cannot be held without a rig and a diagram, which have "
                "the zero and the direction of the joint. Run a diagram with --subject, or take the actuator off the "
                "person and omit --subject"
            )
        joints = {"*": reduce(self.smaller, self.joints.values())} if self.joints else {}
        return replace(self, joints=joints, assistance={})

    def smaller(self, one: Caps, other: Caps) -> Caps:
        """Return the smaller of each quantity of two Caps."""
        least = {key: min(getattr(one, key), getattr(other, key)) for key in ("torque", "speed", "power")}
        try:
            return changed(one, range=other.of_range(one.range), **least)
        except ValueError as error:
            raise BadInput(f"{self.file}: {error}") from None

    def narrow(self, block: Any, caps: Caps, undo: ExitStack) -> None:
        """Narrow the range and the speed that an actuator has as parameters, for tables and setpoints."""
        wanted = {}
        if caps.range and "range" in block.parameters:
            try:
                wanted["range"] = caps.of_range(tuple(block.range))
            except ValueError as error:
                raise BadInput(f"{self.file}: {block.path}: {error}") from None
        if caps.speed < math.inf and "max_velocity" in block.parameters:
            wanted["max_velocity"] = min(block.max_velocity or math.inf, caps.speed)
        for name, value in wanted.items():
            undo.callback(setattr, block, name, getattr(block, name))
            setattr(block, name, value)

    def lower(self, block: Any, name: str, most: float, undo: ExitStack) -> None:
        """Keep a parameter, and the bounds of its live changes, within ± most."""
        entry = f"{block.path}.{name}"
        if name not in block.parameters:
            hint = suggestion(name, block.parameters) or f"it has {', '.join(block.parameters) or 'none'}"
            raise BadInput(f"{self.file}: [assistance] {entry}: no such parameter; {hint}")
        value, bounds = self.number(entry, getattr(block, name)), block.live(name)
        if bounds is not None:
            low, high = max(bounds.min, -most), min(bounds.max, most)
            if low > high:
                raise BadInput(f"{self.file}: [assistance] {entry} = {most:g} is below its live bound {bounds.min:g}")
            before = dict(block.live_bounds)
            undo.callback(setattr, block, "live_bounds", before)
            block.live_bounds = before | {name: LiveBounds(low, high, bounds.slew)}
        undo.callback(setattr, block, name, getattr(block, name))
        setattr(block, name, block.parameters[name].dtype(min(max(value, -most), most)))

    def reconfigure(self, blocks: Iterable[Any]) -> None:
        """Let blocks derive their attributes again. Raises BadInput."""
        for block in blocks:
            try:
                block.reconfigure()
            except DiagramError as error:
                raise BadInput(f"{self.file}: {error.diagnostics[0].message}") from None

    def lines(self, diagram: Diagram) -> list[str]:
        """Return lines on the limits for the operator, with the own limit of an actuator where that is smaller."""
        lines = [f"{self.name} of {self.date}"]
        if self.duration is not None:
            lines[0] += f": at most {self.duration / 60.0:.4g} min, which end with a ramp of {FADE_OUT:g} s"
        for path, caps in sorted(diagram.caps.items()):
            own = getattr(diagram[path], "torque_limit", math.inf)
            words = []
            if caps.torque < math.inf:
                words.append(f"{caps.torque:g} N·m" + f" (its own limit is {own:g} N·m)" * (own <= caps.torque))
            if caps.range:
                words.append(f"{math.degrees(caps.range[0]):.4g} to {math.degrees(caps.range[1]):.4g} deg")
            words += [f"{caps.speed:g} rad/s"] * (caps.speed < math.inf)
            words += [f"{caps.power:g} W"] * (caps.power < math.inf)
            lines.append(f"{path}: {', '.join(words)}")
        lines += [f"{name}: at most {most:g}" for name, most in self.assistance.items()]
        missing = [block.path for block in actuators_of(diagram) if block.path not in diagram.caps]
        return lines + [f"without caps: {', '.join(missing)}"] * bool(missing)


def is_none(value: Any) -> bool:
    """Return whether a quantity of Caps is not limited."""
    return value in (math.inf, ())


def read(path: str | Path) -> Subject:
    """Read a subject file. Raises BadInput with every error."""
    try:
        data = read_small(path)
        content = tomllib.loads(data.decode())
    except OSError as error:
        raise BadInput(f"--subject {path}: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise BadInput(f"--subject {path}: it is not text: a subject file is TOML") from None
    except (ValueError, RecursionError) as error:
        raise BadInput(f"--subject {path}: not TOML: {error}") from None
    return Reader(str(path)).subject(content, sha256(data).hexdigest())


def of_recording(entry: Mapping[str, Any]) -> Subject:
    """Return the Subject of an entry that `recorded` has returned."""
    joints: dict[str, Caps] = {}
    for name, caps in entry["joints"].items():
        values: dict[str, Any] = {key: tuple(value) if key == "range" else value for key, value in caps.items()}
        joints[name] = Caps(**values)
    subject = Subject(
        entry["file"], entry["sha256"], entry["id"], entry["date"], joints, entry["assistance"], entry["duration"]
    )
    return replace(subject, joints={name: changed(caps, source=subject.name) for name, caps in joints.items()})


class Reader:
    """Reader of the content of a subject file, which collects its errors. path : path, for messages"""

    def __init__(self, path: str) -> None:
        self.path, self.problems = path, []

    def subject(self, content: Mapping[str, Any], digest: str) -> Subject:
        """Return the Subject. digest : hex digest of the file. Raises BadInput."""
        self.known(content, ("version", *SIGNATURE, "session", "joint", "assistance"), "")
        if content.get("version") != VERSION:
            self.problems.append(f"version = {content.get('version')!r}: expected version = {VERSION}")
        signed = {name: self.signature(content, name) for name in SIGNATURE}
        session = self.table(content, "session")
        self.known(session, ("duration",), "[session] ")
        duration = self.quantity("[session] duration", session["duration"], "s") if "duration" in session else None
        source = f"subject {signed['id']} ({Path(self.path).name})"
        joints = {name: self.joint(name, table, source) for name, table in self.table(content, "joint").items()}
        assistance = {
            name: self.quantity(f"[assistance] {name}", value, None)
            for name, value in self.table(content, "assistance").items()
        }
        if not (joints or assistance or duration):
            self.problems.append('it limits nothing: add [joint."*"] with torque = 8.0')
        if self.problems:
            raise BadInput("\n".join(f"{self.path}: {problem}" for problem in self.problems))
        return Subject(
            self.path, digest, signed["id"], signed["date"], joints, assistance, duration, signed["signed_by"]
        )

    def known(self, table: Mapping[str, Any], keys: Iterable[str], where: str) -> None:
        """Note the keys of a table that mean nothing. where : its heading"""
        for key in table:
            if key not in keys:
                self.problems.append(
                    f"{where}{key}: no such key; {suggestion(key, keys) or 'it has ' + ', '.join(keys)}"
                )

    def table(self, content: Mapping[str, Any], name: str) -> dict[str, Any]:
        """Return a table, {} without one."""
        found = content.get(name, {})
        if isinstance(found, dict):
            return found
        self.problems.append(f"{name} = {found!r}: expected a table, [{name}]")
        return {}

    def signature(self, content: Mapping[str, Any], name: str) -> str:
        """Return a field of the signature."""
        value = content.get(name)
        if isinstance(value, datetime.date):
            value = value.isoformat()
        if isinstance(value, str) and value.strip():
            return value.strip()
        self.problems.append(f'{name} is missing: whoever answers for these limits writes {name} = "{SIGNATURE[name]}"')
        return ""

    def joint(self, name: str, table: Any, source: str) -> Caps:
        """Return the caps of a table [joint."..."]. source : text that names the file"""
        where = f'[joint."{name}"]'
        if not isinstance(table, dict) or any(isinstance(value, dict) for value in table.values()):
            self.problems.append(
                f'{where}: expected a table of {", ".join(UNITS)}; quote the path: [joint."left/knee"]'
            )
            return Caps()
        self.known(table, UNITS, f"{where} ")
        found: dict[str, Any] = {
            key: self.quantity(f"{where} {key}", value, UNITS[key])
            for key, value in table.items()
            if key in UNITS and key != "range"
        }
        if "range" in table:
            found["range"] = self.range(f"{where} range", table["range"])
        return Caps(**found, source=source)

    def range(self, where: str, value: Any) -> tuple[float, ...]:
        """Return a range of angles, rad."""
        ends = [self.quantity(where, end, "rad", signed=True) for end in value] if isinstance(value, list) else []
        if len(ends) != 2 or not ends[0] < ends[1]:
            self.problems.append(f'{where} = {value!r}: expected two angles in ascending order, ["-5 deg", "90 deg"]')
        elif max(map(abs, ends)) > TURN:
            self.problems.append(f'{where} = {value!r}: more than a turn: did you mean ["{value[0]} deg", ...]?')
        return tuple(ends)

    def quantity(self, where: str, value: Any, unit: str | None, signed: bool = False) -> float:
        """Return a number in a unit, SI; text has its own unit. signed : whether it may be 0 or less"""
        words = "a finite number" if signed else "a finite number above 0"
        try:
            number = parse_quantity(value, unit) if isinstance(value, str) else value
            if isinstance(number, bool) or not isinstance(number, (int, float)):
                raise ValueError(f"expected {words}")
            if not math.isfinite(number) or not (signed or number > 0.0):
                raise ValueError(f"expected {words}")
            return float(number)
        except ValueError as error:
            example = f", as in 8.0 or '8 {unit}'" if unit else ""
            self.problems.append(f"{where} = {value!r}: {error}{example}")
            return 1.0
