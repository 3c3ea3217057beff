"""`move ID`: move one actuator of a bus within small limits, in a regular run."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from blocks.families import example_models, families, find_model
from runtime.cli.configure import drive_id
from runtime.cli.parsing import Parser, add_bus, add_options, fields_of, instance
from runtime.cli.run import carry_out
from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput
from runtime.host.options import TIME_LIMIT, finite, number, option
from runtime.record.report import summary
from runtime.robot.rig.errors import RigError
from runtime.session.request import Request
from runtime.setup.commissioning import move
from runtime.setup.commissioning.bus import entry, single_bus

if TYPE_CHECKING:
    from argparse import Namespace

    from graph.family import Drive
    from runtime.robot.rig.file import RigBus
    from runtime.session.result import Result

LIMIT_SHARE = 0.1  # default torque limit, share of the rated torque
STIFFNESS_PER_LIMIT = 2.0  # 1/rad, default of --position
POSITION_DAMPING_PER_LIMIT = 0.4  # s/rad, default of --position
VELOCITY_DAMPING_PER_LIMIT = 1.0  # s/rad, default of --velocity

EPILOG = """\
examples:
  move 3 --channel can0 --model {0} --torque 0.5
  move 3 --channel can0 --model {0} --position 0.3 --speed 0.2
  move 9 --rig lab.toml --bus legs --model {1} --velocity 1 --duration 3

This is a full run on a rig: with a guardian, a pre-flight table to confirm with Enter, torque that fades in, a
recording, and a safe stop at the end. Hold an emergency stop that cuts the power, and do not wear the robot.
"""


def _target(flag: str, unit: str, letter: str, text: str) -> float | None:
    return option(flag, default=None, group="target", type=finite(flag, unit), metavar=letter, help=text)


def _positive(
    flag: str, unit: str, letter: str, text: str, default: float | None = None, maximum: float = math.inf
) -> Any:
    return option(flag, default=default, type=number(flag, unit, maximum), metavar=letter, help=text)


@dataclass(frozen=True)
class Movement:
    """Options of a movement."""

    torque: float | None = _target("--torque", "N·m", "T", "torque in N·m")
    position: float | None = _target("--position", "rad", "P", "position in rad from the zero of the drive")
    velocity: float | None = _target("--velocity", "rad/s", "V", "velocity in rad/s")
    limit: float | None = _positive("--limit", "N·m", "T", "torque limit in N·m (default: a tenth of the rated torque)")
    duration: float = _positive("--duration", "seconds", "S", "duration in s (default: 5)", 5.0, TIME_LIMIT)
    rise: float = _positive("--rise", "seconds", "S", "time in s from zero to the target, and back (default: 1)", 1.0)
    speed: float = _positive("--speed", "rad/s", "V", "velocity toward a position in rad/s (default: 0.5)", 0.5)
    stiffness: float | None = _positive(
        "--stiffness", "N·m/rad", "K", "stiffness of a position in N·m/rad (default: twice the limit)"
    )
    damping: float | None = _positive(
        "--damping", "N·m·s/rad", "B", "damping of a position or velocity in N·m·s/rad (default: from the limit)"
    )
    fastest: float = _positive("--fastest", "rad/s", "V", "velocity that ends the run, in rad/s (default: 10)", 10.0)


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code of the run."""
    options = parse(arguments)
    can_id = drive_id(options.can_id)
    kind, target = target_of(options)
    drive, model = model_of(options)
    if kind not in drive.movements:
        raise BadInput(f"--{kind}: {drive.block.__name__} is commanded with --{', --'.join(drive.movements)}")
    limit = limit_of(options, model, kind, target)
    bus = single_bus(options)
    damping = limit * (VELOCITY_DAMPING_PER_LIMIT if kind == "velocity" else POSITION_DAMPING_PER_LIMIT)
    settings = {
        "block": drive.block.__name__,
        "model": model.name,
        "bus": bus.name,
        "can_id": can_id,
        "kind": kind,
        "target": target,
        "limit": limit,
        **{name: getattr(options, name) for name in ("duration", "rise", "speed", "fastest", "rate")},
        "stiffness": options.stiffness or STIFFNESS_PER_LIMIT * limit,
        "damping": options.damping or damping,
    }
    if drive.wire is None:
        check_law(model, settings)
    rated = f" ({limit / model.rated:.0%} of rated)" if model.rated else ""
    unbounded = kind not in drive.bounded
    bound = "torque limited only by the settings of the drive" if unbounded else f"torque limit {limit:g} N·m{rated}"
    print_lines(
        [
            f"{model.name}, id {can_id} on {bus.channel}: {kind} {target:g} {UNITS[kind]} for {options.duration:g} s, "
            f"{bound}; the run ends beyond {options.fastest:g} rad/s",
            "joint limits are not checked: only move an actuator that can turn freely",
        ]
    )
    result = run_movement(options, bus, settings)
    print_lines(summary.summary(result))
    return summary.exit_code(result.outcome)


def parse(arguments: Sequence[str]) -> Namespace:
    """Parse the command line. Returns the options."""
    parser = Parser(
        "move",
        "Move one actuator: with a torque, to a position, or at a velocity, within small limits.",
        EPILOG.format(*example_models()),
    )
    parser.add_argument("can_id", metavar="ID", help="CAN id of the drive; `scan` lists those that respond")
    add_bus(parser)
    add_model(parser, "model of the actuator in the vendor's spelling: {} (drives do not report it)")
    add_options(parser, Movement, *fields_of(Movement))
    add_options(
        parser,
        Request,
        *("rate", "subject"),
        *("yes", "accept", "record", "no_record", "plotjuggler", "realtime", "overrun", "spin"),
        in_sections=True,
        subject={"help": "limits for one person: the smallest of any joint in this file"},
        rate={"default": 200.0, "help": "ticks per second (default: 200)"},
        yes={"help": "arm without waiting for Enter"},
    )
    return parser.parse_args(arguments)


def run_movement(options: Namespace, bus: RigBus, settings: Mapping[str, Any]) -> Result:
    """Carry out the run of a movement. Returns its Result."""
    with tempfile.TemporaryDirectory(prefix="tickwork-") as place:
        rig = Path(place) / "move.toml"  # only the bus: the diagram has no other devices
        rig.write_text("\n".join([*entry(bus), ""]), encoding="utf-8")
        request = instance(
            Request,
            options,
            file=Path(move.__file__),
            rig=rig,
            settings=[(name, str(text)) for name, text in settings.items()],
            bitrate=None,
            bench=True,
        )
        try:
            return carry_out(request)
        except RigError as error:  # without the path of the temporary file
            raise BadInput("\n".join(map(str, error.problems))) from None


UNITS = {"torque": "N·m", "position": "rad", "velocity": "rad/s"}


def target_of(options: Namespace) -> tuple[str, float]:
    """Return (kind of movement, target): N·m, rad or rad/s. Raises BadInput without one."""
    for kind in UNITS:
        if getattr(options, kind) is not None:
            return kind, getattr(options, kind)
    raise BadInput("no target given: pass --torque T, --position P or --velocity V")


def add_model(parser: Parser, text: str) -> None:
    """Add --model, and the options of families that select another block for it. text : help, with {} for examples"""
    parser.add_argument("--model", metavar="NAME", help=text.format(", ".join(example_models())))
    how = parser.add_mutually_exclusive_group()
    texts = {}
    for drive in (drive for family in families() for drive in family.drives if drive.option):
        texts.setdefault(drive.option, []).append(drive.help)
    for name, lines in texts.items():
        how.add_argument(f"--{name}", dest="option", action="store_const", const=name, help="; ".join(lines))


def model_of(options: Namespace) -> tuple[Drive, Any]:
    """Return (graph.family.Drive, model). Raises BadInput."""
    if not options.model:
        examples = ", ".join(f"--model {name}" for name in example_models())
        raise BadInput(f"no model given: it defines the encoded ranges, and drives do not report it. Pass {examples}")
    try:
        return find_model(options.model, options.option or "")
    except ValueError as error:
        raise BadInput(f"--model {error}") from None


def limit_of(options: Namespace, model: Any, kind: str, target: float) -> float:
    """Return the torque limit in N·m. Raises BadInput for a target outside the limits."""
    if model.rated is None and options.limit is None:
        raise BadInput(
            f"--model {model.name}: its rated torque is not published: pass a --limit in N·m, safe for your joint"
        )
    rated = model.wire_torque if model.rated is None else model.rated
    limit = options.limit or LIMIT_SHARE * rated
    model = replace(model, rated=rated)
    if limit > model.rated:
        raise BadInput(f"--limit {limit:g}: at most the rated torque of {model.name}, {model.rated:g} N·m")
    if kind == "torque" and abs(target) > limit:
        allowed = (
            f"--limit {abs(target):g} allows it"
            if abs(target) <= model.rated
            else f"the highest limit is its rated torque, {model.rated:g} N·m"
        )
        raise BadInput(
            f"--torque {target:g} exceeds the limit of {limit:g} N·m ({limit / model.rated:.0%} of rated); {allowed}"
        )
    if kind == "velocity" and abs(target) >= options.fastest:
        raise BadInput(
            f"--velocity {target:g}: the run ends at {options.fastest:g} rad/s; --fastest {2 * abs(target):g} allows it"
        )
    if kind == "position" and abs(target) > model.wire_position:
        raise BadInput(
            f"--position {target:g}: outside the encoded range of {model.name}, ±{model.wire_position:g} rad"
        )
    if kind == "velocity" and abs(target) > model.wire_velocity:
        raise BadInput(
            f"--velocity {target:g}: outside the encoded range of {model.name}, ±{model.wire_velocity:g} rad/s"
        )
    return limit


def check_law(model: Any, settings: Mapping[str, Any]) -> None:
    """Raise BadInput for a stiffness or damping outside the encoded range."""
    for name, highest in (("stiffness", model.wire_stiffness), ("damping", model.wire_damping)):
        if settings[name] > highest:
            raise BadInput(f"--{name} {settings[name]:g}: at most {highest:g} in the encoding of {model.name}")
