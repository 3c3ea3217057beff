"""`move ID`: one actuator of a bus, gently, through the ordinary run."""

import tempfile
from dataclasses import replace
from pathlib import Path

from blocks.families import example_models, families, find_model
from runtime.base.errors import BadInput
from runtime.base.options import TIME_LIMIT, number
from runtime.cli.configure import drive_id
from runtime.cli.parsing import Parser, add_bus, add_options, instance
from runtime.cli.run import carried_out
from runtime.commissioning import move
from runtime.commissioning.bus import entry, single_bus
from runtime.console.terminal import tell
from runtime.report import summary
from runtime.session.request import Request

SHARE = 0.1  # of the rated torque, by default
SPRING = 2.0  # 1/rad: with the limit, the stiffness of a position; its damping is a fifth of that
DAMPER = 1.0  # s/rad: with the limit, the damping of a velocity

EPILOG = """\
  move 3 --channel can0 --model {0} --torque 0.5
  move 3 --channel can0 --model {0} --position 0.3 --speed 0.2
  move 9 --rig lab.toml --bus legs --model {1} --velocity 1 --duration 3

This is a full run on a rig: with a guardian, a pre-flight table to confirm with Enter, torque that fades in, a
recording, and a safe stop at the end. Hold an emergency stop that cuts the power, and do not wear the robot.
"""


def main(arguments):
    parser = Parser(
        "move",
        "Move one actuator: with a torque, to a position, or at a velocity, within small limits.",
        EPILOG.format(*example_models()),
    )
    parser.add_argument("can_id", metavar="ID", help="of the drive; `scan` tells who is there")
    add_bus(parser)
    add_model(parser, "of the actuator, as the vendor writes it: {} (a drive does not report it)")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--torque", type=value("--torque", "N·m"), metavar="T", help="N·m")
    what.add_argument("--position", type=value("--position", "rad"), metavar="P", help="rad, of the drive's own zero")
    what.add_argument("--velocity", type=value("--velocity", "rad/s"), metavar="V", help="rad/s")
    parser.add_argument(
        "--limit", type=number("--limit", "N·m"), metavar="T", help="torque at most (default: a tenth of the rated one)"
    )
    parser.add_argument(
        "--duration", type=number("--duration", "seconds", TIME_LIMIT), default=5.0, metavar="S", help="default: 5"
    )
    parser.add_argument(
        "--rise",
        type=number("--rise", "seconds"),
        default=1.0,
        metavar="S",
        help="to the target and back to zero (default: 1)",
    )
    parser.add_argument(
        "--speed",
        type=number("--speed", "rad/s"),
        default=0.5,
        metavar="V",
        help="toward a position (default: 0.5 rad/s)",
    )
    parser.add_argument(
        "--stiffness",
        type=number("--stiffness", "N·m/rad"),
        metavar="K",
        help="of a position (default: twice the limit)",
    )
    parser.add_argument(
        "--damping",
        type=number("--damping", "N·m·s/rad"),
        metavar="B",
        help="of a position or a velocity (default: from the limit)",
    )
    parser.add_argument(
        "--fastest",
        type=number("--fastest", "rad/s"),
        default=10.0,
        metavar="V",
        help="velocity that ends the run (default: 10 rad/s)",
    )
    add_options(
        parser,
        Request,
        "rate",
        *("record", "no_record", "plotjuggler", "realtime", "yes", "overrun", "spin"),
        rate={"default": 200.0, "help": "ticks per second (default: 200)"},
        yes={"help": "arm without waiting for Enter"},
    )
    options = parser.parse_args(arguments)
    can_id = drive_id(options.can_id)
    kind, target = target_of(options)
    drive, found = model_of(options)
    if kind not in drive.movements:
        raise BadInput(f"--{kind}: {drive.block.__name__} is commanded with --{', --'.join(drive.movements)}")
    limit = limit_of(options, found, kind, target)
    unbounded = kind not in drive.bounded
    bus = single_bus(options)
    settings = {
        "block": drive.block.__name__,
        "model": found.name,
        "bus": bus.name,
        "can_id": can_id,
        "kind": kind,
        "target": target,
        "limit": limit,
        "duration": options.duration,
        "rise": options.rise,
        "speed": options.speed,
        "fastest": options.fastest,
        "rate": options.rate,
        "stiffness": options.stiffness or SPRING * limit,
        "damping": options.damping or limit * (DAMPER if kind == "velocity" else SPRING / 5.0),
    }
    if drive.wire is None:
        check_law(found, settings)
    rated = f" ({limit / found.rated:.0%} of rated)" if found.rated else ""
    bound = (
        "its torque bounded by the drive's own settings alone" if unbounded else (f"torque limit {limit:g} N·m{rated}")
    )
    tell(
        [
            f"{found.name}, id {can_id} on {bus.channel}: {kind} {target:g} {UNITS[kind]} for {options.duration:g} s, "
            f"{bound}; the run ends beyond {options.fastest:g} rad/s",
            "no range of a joint is known here: nothing ends the run at the end of a joint's motion, so move an "
            "actuator that turns freely",
        ]
    )
    with tempfile.TemporaryDirectory(prefix="tickwork-") as place:
        rig = Path(place) / "move.toml"  # the bus alone: a robot's devices are not in this diagram
        rig.write_text("\n".join([*entry(bus), ""]), encoding="utf-8")
        result = carried_out(
            instance(
                Request,
                options,
                file=Path(move.__file__),
                rig=rig,
                settings=[(name, str(text)) for name, text in settings.items()],
                bitrate=None,
                bench=True,
            )
        )
    tell(summary.summary(result))
    return summary.exit_code(result.outcome)


UNITS = {"torque": "N·m", "position": "rad", "velocity": "rad/s"}


def target_of(options):
    for kind in UNITS:
        if getattr(options, kind) is not None:
            return kind, getattr(options, kind)
    raise BadInput("where to? one of --torque T, --position P and --velocity V")


def add_model(parser, text):
    """Add --model, and the options of the families that select another block for it. text : with {} for examples"""
    parser.add_argument("--model", metavar="NAME", help=text.format(", ".join(example_models())))
    how = parser.add_mutually_exclusive_group()
    texts = {}
    for drive in (drive for family in families() for drive in family.drives if drive.option):
        texts.setdefault(drive.option, []).append(drive.help)
    for option, lines in texts.items():
        how.add_argument(f"--{option}", dest="option", action="store_const", const=option, help="; ".join(lines))


def model_of(options):
    """Return (graph.family.Drive, model). BadInput"""
    if not options.model:
        examples = ", ".join(f"--model {name}" for name in example_models())
        raise BadInput(f"which model? its ranges make a torque of a frame, and a drive does not report it: {examples}")
    try:
        return find_model(options.model, options.option or "")
    except ValueError as error:
        raise BadInput(f"--model {error}") from None


def limit_of(options, found, kind, target):
    """N·m. BadInput"""
    if found.rated is None and options.limit is None:
        raise BadInput(
            f"--model {found.name}: its rated torque is not published: say a --limit in N·m that is safe for your joint"
        )
    rated = found.wire_torque if found.rated is None else found.rated
    limit = options.limit or SHARE * rated
    found = replace(found, rated=rated)
    if limit > found.rated:
        raise BadInput(f"--limit {limit:g}: at most the rated torque of {found.name}, {found.rated:g} N·m")
    if kind == "torque" and abs(target) > limit:
        allowed = (
            f"--limit {abs(target):g} allows it"
            if abs(target) <= found.rated
            else (f"its rated torque is {found.rated:g} N·m")
        )
        raise BadInput(
            f"--torque {target:g} is beyond the limit of {limit:g} N·m ({limit / found.rated:.0%} of rated); {allowed}"
        )
    if kind == "velocity" and abs(target) >= options.fastest:
        raise BadInput(
            f"--velocity {target:g}: the run ends at {options.fastest:g} rad/s; --fastest {2 * abs(target):g} allows it"
        )
    if kind == "position" and abs(target) > found.wire_position:
        raise BadInput(f"--position {target:g}: the wire says ± {found.wire_position:g} rad")
    if kind == "velocity" and abs(target) > found.wire_velocity:
        raise BadInput(f"--velocity {target:g}: the wire of {found.name} says ± {found.wire_velocity:g} rad/s")
    return limit


def check_law(found, settings):
    """BadInput where the wire cannot say the spring or the damper."""
    for name, most in (("stiffness", found.wire_stiffness), ("damping", found.wire_damping)):
        if settings[name] > most:
            raise BadInput(f"--{name} {settings[name]:g}: the wire of {found.name} says at most {most:g}")


def value(option, unit):
    def parse(text):
        try:
            found = float(text)
        except ValueError:
            found = float("nan")
        if not abs(found) < float("inf"):
            raise BadInput(f"{option} {text}: expected a number of {unit}")
        return found

    return parse
