"""`rate`: find the highest rate at which actuators miss no reply."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graph.budget import frame_bits
from runtime.cli.parsing import Parser, add_number, add_options
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.options import number, whole_number
from runtime.host.replaced_file import replacement
from runtime.session.request import Request
from runtime.setup.bench.rate.robot import ACTUATORS_LIMIT
from runtime.setup.bench.rate.search import HIGHEST_RATE, LOWEST_RATE, RESOLUTION, highest

if TYPE_CHECKING:
    from argparse import Namespace

    from runtime.robot.rig.file import RigFile
    from runtime.setup.bench.rate.steps import Step

STEP_DURATION, PAPER_STEP_DURATION, PAPER_VALIDATION_DURATION = 2.0, 60.0, 300.0  # s
BITRATE = 1e6  # bit/s
TRAFFIC_RATE = 50.0  # Hz of a robot whose frames are counted; any rate gives the same frames


@dataclass(frozen=True)
class Result:
    """Highest rate of one number of actuators.

    rate, limit, worst : Hz, measured; at full bus load; at full bus load with the most stuff bits
    steps : number of rates that were tried
    why : failure of the lowest rate, if no rate passed
    validated : Step of the validation, or None
    """

    actuators: int
    rate: float
    limit: float
    worst: float
    steps: int
    why: str = ""
    validated: Step | None = None


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if a validation failed."""
    options = parse(arguments)
    rig = None
    if options.rig is not None:
        from runtime.robot.rig.file import read

        rig = read(options.rig)
        if len(rig.buses) != 1:
            raise BadInput(f"{options.rig}: expected one bus, with the actuators, got {len(rig.buses)}")
    make = maker(options, "can" if rig is None else next(iter(rig.buses)))
    bitrate = options.bitrate if rig is None else next(iter(rig.buses.values())).bitrate
    where = f"in virtual time, at {bitrate / 1e6:g} Mbit/s" if rig is None else f"on {options.rig}"
    print_lines(
        [
            f"{options.model}, zero torque, {where}: {options.low:g} to {options.high:g} Hz, resolution "
            f"{options.resolution:g} Hz, {options.seconds:g} s per step",
            f"{'actuators':>9}{'highest rate':>16}{'bus full at':>14}{'worst stuffing':>16}{'tried':>8}",
        ]
    )
    results, confirmed = [], options.yes
    for many in range(options.first, options.last + 1):
        row, confirmed = one(options, make, list(range(1, many + 1)), rig, bitrate, confirmed)
        results.append(row)
        print_lines(
            [
                f"{row.actuators:>9}{row.rate:>13.0f} Hz{row.limit:>11.0f} Hz{row.worst:>13.0f} "
                f"Hz{row.steps:>8}{_validation(row)}{row.why}"
            ]
        )
    if options.last == ACTUATORS_LIMIT:
        print_lines(
            [
                "paper, with 8: 470 Hz on a Jetson, 260 Hz on a Raspberry Pi 3B+; it counts only full queues and "
                "silences of 0.25 s"
            ]
        )
    _picture(options, results)
    return CHECK_FAILED if any(row.validated is not None and not row.validated.passed for row in results) else OK


def parse(arguments: Sequence[str]) -> Namespace:
    """Parse the arguments. Raises BadInput for options that exclude each other."""
    from blocks.families import benchmark

    typical = benchmark("can").parameters["model"]
    parser = Parser("rate", "Find the highest rate at which actuators at zero torque miss no reply.")
    add_options(parser, Request, "rig")
    parser.add_argument(
        "--model",
        default=typical,
        metavar="M",
        help=f"actuator model with torque commands; `blocks --actuators` lists the models (default: {typical})",
    )
    parser.add_argument(
        "--actuators",
        type=span,
        default=(1, ACTUATORS_LIMIT),
        metavar="N",
        help="number of actuators, or a range: 8, 1..8 (default: 1..8)",
    )
    add_number(parser, "--low", "Hz", "HZ", "lowest rate of the search", default=LOWEST_RATE)
    add_number(parser, "--high", "Hz", "HZ", "highest rate of the search", default=HIGHEST_RATE, maximum=1e5)
    parser.add_argument(
        "--resolution",
        type=number("--resolution", "Hz"),
        default=RESOLUTION,
        metavar="HZ",
        help=f"resolution of the search (default: {RESOLUTION:g}, as in the paper)",
    )
    add_number(
        parser, "--seconds", "seconds", "S", f"duration of each step (default: {STEP_DURATION:g})", maximum=3600.0
    )
    parser.add_argument(
        "--paper", action="store_true", help="steps of 60 s and a validation of 5 minutes, as in the paper"
    )
    parser.add_argument(
        "--bitrate",
        type=number("--bitrate", "bit/s", 1e9),
        default=BITRATE,
        metavar="N",
        help="bitrate of the simulated bus in bit/s (default: 1e6)",
    )
    parser.add_argument(
        "--upper-zero",
        action="store_true",
        help="in simulation: encode zero as the upper of the two middle codes (8000 800 000 000 800)",
    )
    parser.add_argument(
        "--picture", type=Path, default=Path("rate.png"), metavar="FILE", help="picture file (default: rate.png)"
    )
    parser.add_argument("--yes", action="store_true", help="on a rig: arm without waiting for Enter")
    parser.add_argument(
        "--realtime",
        choices=("off", "try", "require"),
        default="try",
        help="on a rig: request real-time priority, see `run --help` (default: try)",
    )
    options = parser.parse_args(arguments)
    options.first, options.last = options.actuators
    options.seconds = options.seconds or (PAPER_STEP_DURATION if options.paper else STEP_DURATION)
    if options.low >= options.high:
        raise BadInput(f"--low {options.low:g} is not below --high {options.high:g}")
    if options.upper_zero and options.rig is not None:
        raise BadInput("--upper-zero and --rig exclude each other: the upper code is a small torque")
    return options


def span(text: str) -> tuple[int, int]:
    """Return (lowest, highest) of "8" or "1..8". Raises BadInput."""
    first, dots, last = text.partition("..")
    read = whole_number("--actuators", ACTUATORS_LIMIT)
    low, high = read(first), read(last if dots else first)
    if low > high:
        raise BadInput(f"--actuators {text}: expected the lower number first")
    return low, high


def maker(options: Namespace, bus: str) -> Callable[[int], Any]:
    """Return a function of a CAN id that makes an actuator of the model. Raises BadInput for an unknown model."""
    from blocks.families import find_model

    try:
        drive, _ = find_model(options.model)
    except ValueError as error:
        raise BadInput(f"--model {error}") from None
    return lambda can_id: drive.block(options.model, bus=bus, can_id=can_id, name=f"actuator{can_id}", timeout=0.5)


def one(
    options: Namespace, make: Callable[[int], Any], ids: list[int], rig: RigFile | None, bitrate: float, confirmed: bool
) -> tuple[Result, bool]:
    """Measure with these ids. Returns (Result, whether the operator has confirmed).

    make : as returned by `maker`
    bitrate : bit/s
    confirmed : whether the operator has confirmed before
    """
    from runtime.setup.bench.rate.robot import robot
    from runtime.setup.bench.rate.steps import OnRig, Simulated

    simulated = Simulated(make, ids, bitrate, options.seconds, options.upper_zero)
    attempt = (
        simulated
        if rig is None
        else OnRig(make, ids, rig, options.seconds, confirmed, options.realtime, print_to_stderr)
    )
    with Progress(f"{len(ids)} actuators: searching") as progress:
        steps_limit = 1 + math.ceil(math.log2(max(2.0, (options.high - options.low) / options.resolution)))
        tried = itertools.count()

        def with_progress(rate):
            progress(next(tried) / steps_limit)
            return attempt(rate)

        rate, steps = highest(with_progress, options.low, options.high, options.resolution)
    validated = None
    if options.paper and rate > 0.0:
        attempt.seconds = PAPER_VALIDATION_DURATION
        validated = attempt(rate)
    worst = bitrate / sum(
        frame_bits(*frame)[1] for block in robot(make, ids, TRAFFIC_RATE) for frame in getattr(block, "traffic", list)()
    )
    why = "" if rate > 0.0 else f"  {options.low:g} Hz failed: {_failure(steps[0])}"
    return Result(len(ids), rate, simulated.limit(), worst, len(steps), why, validated), confirmed or rig is not None


def _failure(step: Step) -> str:
    return step.why or f"{step.missed} of {step.commands} commands without a reply, {step.lost} ticks lost"


def _validation(row: Result) -> str:
    if row.validated is None:
        return ""
    return "  5 min: passed" if row.validated.passed else f"  5 min: {_failure(row.validated)}"


def _picture(options: Namespace, results: Sequence[Result]) -> None:
    from runtime.setup.bench.rate.picture import draw

    try:
        with replacement(options.picture) as file:
            draw(
                [(row.actuators, row.rate, row.limit, row.worst) for row in results],
                f"{options.model}: highest rate without a missing reply",
                file,
            )
    except OSError as error:
        raise BadInput(f"--picture {options.picture}: {error.strerror}") from None
    print_lines([f"picture: {options.picture}"])
