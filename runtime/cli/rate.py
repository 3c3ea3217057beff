"""`python -m runtime rate`: the command line, and what it prints."""

import itertools
import math
from dataclasses import dataclass
from pathlib import Path

from graph.budget import frame_bits
from runtime.base.errors import CHECK_FAILED, OK, BadInput
from runtime.base.options import count, number
from runtime.bench.rate.robot import ACTUATORS_LIMIT
from runtime.bench.rate.search import HIGHEST_RATE, LOWEST_RATE, RESOLUTION, highest
from runtime.cli.parsing import Parser, add_options
from runtime.console.progress import Progress
from runtime.console.terminal import complain, tell
from runtime.session.request import Request

SECONDS, PAPER_SECONDS, PAPER_VALIDATION = 2.0, 60.0, 300.0  # s of a step; those of the paper, and of its validation
BITRATE = 1e6
SLOW = 50.0  # Hz; any will do


@dataclass(frozen=True)
class Found:
    """Of one number of actuators.

    rate, limit, worst in Hz; steps : how many rates were tried; why : what was wrong where none passed
    validated : None, or the Step that did it
    """

    actuators: int
    rate: float
    limit: float
    worst: float
    steps: int
    why: str = ""
    validated: object = None


def main(arguments):
    """Returns the exit code: 1 where a validation has failed."""
    options = parse(arguments)
    rig = None
    if options.rig is not None:
        from runtime.rig import read

        rig = read(options.rig)
        if len(rig.buses) != 1:
            raise BadInput(f"{options.rig}: name one bus, that of the actuators; there are {len(rig.buses)}")
    make = maker(options, "can" if rig is None else next(iter(rig.buses)))
    bitrate = options.bitrate if rig is None else next(iter(rig.buses.values())).bitrate
    where = f"in virtual time, at {bitrate / 1e6:g} Mbit/s" if rig is None else f"on {options.rig}"
    tell(
        [
            f"{options.model}, zero torque, {where}: {options.low:g} to {options.high:g} Hz to {options.resolution:g} "
            "Hz, "
            f"steps of {options.seconds:g} s, every answer that does not come in time is counted",
            f"{'actuators':>9}{'highest rate':>16}{'bus full at':>14}{'worst stuffing':>16}{'tried':>8}",
        ]
    )
    found, confirmed = [], options.yes
    for many in range(options.first, options.last + 1):
        row, confirmed = one(options, make, list(range(1, many + 1)), rig, bitrate, confirmed)
        found.append(row)
        tell(
            [
                f"{row.actuators:>9}{row.rate:>13.0f} Hz{row.limit:>11.0f} Hz{row.worst:>13.0f} "
                f"Hz{row.steps:>8}{validation(row)}{row.why}"
            ]
        )
    if options.last == ACTUATORS_LIMIT:
        tell(
            [
                "paper, with 8: 470 Hz on a Jetson, 260 Hz on a Raspberry Pi 3B+; it counts full queues and 0.25 s of "
                "silence alone"
            ]
        )
    picture(options, found)
    return CHECK_FAILED if any(row.validated is not None and not row.validated.passed for row in found) else OK


def parse(arguments):
    from blocks.families import benchmark

    typical = benchmark("can").parameters["model"]
    parser = Parser("rate", "Find the highest rate at which actuators that are commanded zero torque miss no answer.")
    add_options(parser, Request, "rig")
    parser.add_argument(
        "--model",
        default=typical,
        metavar="M",
        help=f"a model whose torque can be commanded; `blocks --actuators` lists them (default: {typical})",
    )
    parser.add_argument(
        "--actuators",
        type=span,
        default=(1, ACTUATORS_LIMIT),
        metavar="N",
        help="how many, or from how many to how many: 8, 1..8 (default: 1..8)",
    )
    parser.add_argument(
        "--low",
        type=number("--low", "Hz"),
        default=LOWEST_RATE,
        metavar="HZ",
        help=f"begin of the search (default: {LOWEST_RATE:g})",
    )
    parser.add_argument(
        "--high",
        type=number("--high", "Hz", 1e5),
        default=HIGHEST_RATE,
        metavar="HZ",
        help=f"its end (default: {HIGHEST_RATE:g})",
    )
    parser.add_argument(
        "--resolution",
        type=number("--resolution", "Hz"),
        default=RESOLUTION,
        metavar="HZ",
        help=f"how near the search comes (default: {RESOLUTION:g}, as in the paper)",
    )
    parser.add_argument(
        "--seconds",
        type=number("--seconds", "seconds", 3600.0),
        metavar="S",
        help=f"of each step (default: {SECONDS:g})",
    )
    parser.add_argument(
        "--paper", action="store_true", help="steps of 60 s, and 5 minutes at what was found, as in the paper"
    )
    parser.add_argument(
        "--bitrate",
        type=number("--bitrate", "bit/s", 1e9),
        default=BITRATE,
        metavar="N",
        help="of the simulated bus (default: 1e6)",
    )
    parser.add_argument(
        "--upper-zero",
        action="store_true",
        help="simulated: send zero as the codes above the middle, 8000 800 000 000 800, as Epically Powerful does",
    )
    parser.add_argument(
        "--picture",
        type=Path,
        default=Path("rate.png"),
        metavar="FILE",
        help="where the picture goes (default: rate.png)",
    )
    parser.add_argument("--yes", action="store_true", help="on a rig: arm without waiting for Enter")
    parser.add_argument(
        "--realtime", choices=("off", "try", "require"), default="try", help="on a rig, as of `run` (default: try)"
    )
    options = parser.parse_args(arguments)
    options.first, options.last = options.actuators
    options.seconds = options.seconds or (PAPER_SECONDS if options.paper else SECONDS)
    if options.low >= options.high:
        raise BadInput(f"--low {options.low:g} is not below --high {options.high:g}")
    if options.upper_zero and options.rig is not None:
        raise BadInput("--upper-zero and --rig exclude each other: it is a torque, if a small one")
    return options


def span(text):
    """(fewest, most) of "8" or "1..8"."""
    first, dots, last = text.partition("..")
    read = count("--actuators", ACTUATORS_LIMIT)
    low, high = read(first), read(last if dots else first)
    if low > high:
        raise BadInput(f"--actuators {text}: from the lower number to the higher")
    return low, high


def maker(options, bus):
    """What makes an actuator of the model on a bus. BadInput where there is no such model."""
    from blocks.families import find_model

    try:
        drive, _ = find_model(options.model)
    except ValueError as error:
        raise BadInput(f"--model {error}") from None
    return lambda can_id: drive.block(options.model, bus=bus, can_id=can_id, name=f"actuator{can_id}", timeout=0.5)


def one(options, make, ids, rig, bitrate, confirmed):
    """(Found, whether a person has confirmed) for these ids."""
    from runtime.bench.rate.robot import robot
    from runtime.bench.rate.steps import OnRig, Simulated

    simulated = Simulated(make, ids, bitrate, options.seconds, options.upper_zero)
    attempt = (
        simulated if rig is None else OnRig(make, ids, rig, options.seconds, confirmed, options.realtime, complain)
    )
    with Progress(f"{len(ids)} actuators: searching") as progress:
        most = 1 + math.ceil(math.log2(max(2.0, (options.high - options.low) / options.resolution)))
        tried = itertools.count()

        def told(rate):
            progress(next(tried) / most)
            return attempt(rate)

        rate, steps = highest(told, options.low, options.high, options.resolution)
    validated = None
    if options.paper and rate > 0.0:
        attempt.seconds = PAPER_VALIDATION
        validated = attempt(rate)
    worst = bitrate / sum(
        frame_bits(*frame)[1] for block in robot(make, ids, SLOW) for frame in getattr(block, "traffic", list)()
    )
    why = "" if rate > 0.0 else f"  {options.low:g} Hz failed: {failure(steps[0])}"
    return Found(len(ids), rate, simulated.limit(), worst, len(steps), why, validated), confirmed or rig is not None


def failure(step):
    return step.why or f"{step.missed} of {step.commands} commands unanswered, {step.lost} ticks lost"


def validation(row):
    if row.validated is None:
        return ""
    return "  5 min: passed" if row.validated.passed else f"  5 min: {failure(row.validated)}"


def picture(options, found):
    from runtime.bench.rate.picture import draw

    try:
        with open(options.picture, "wb") as file:
            draw(
                [(row.actuators, row.rate, row.limit, row.worst) for row in found],
                f"{options.model}: highest rate without a missing answer",
                file,
            )
    except OSError as error:
        raise BadInput(f"--picture {options.picture}: {error.strerror}") from None
    tell([f"picture: {options.picture}"])
