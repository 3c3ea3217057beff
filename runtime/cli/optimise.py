"""`optimise FILE`: optimise live parameters of a robot on the wearer, or on a simulated one."""

from __future__ import annotations

import json
import math
import os
import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from runtime.cli.parsing import Parser, add_count, add_number, add_options, fields_of, instance
from runtime.host.console.terminal import print_lines, print_to_stderr, program
from runtime.host.errors import OK, BadInput
from runtime.host.options import settings

if TYPE_CHECKING:
    from argparse import Namespace

    from graph.schedule import Column, Schedule
    from runtime.experiments.optimisation.parameters import Parameter
    from runtime.session.request import Request
    from runtime.session.result import Result

DESCRIPTION = (
    "Run a robot as `run` does, and optimise live parameters while a wearer uses it: propose values, ramp to them, "
    "wait, measure a cost, and continue. Keys: y applies a proposal, n skips it, p pauses, r repeats the measurement, "
    "space stops the robot."
)
EPILOG = """\
costs:
  metabolic.tsv            table of a metabolic cart, a file that grows; tcp:HOST:PORT, serial:DEVICE@BAUD, lsl:STREAM
  signal:left/knee.torque  mean of a recorded signal of the diagram
  typed                    a number that the operator types

example:
  python -m runtime optimise diagrams/knee_exo.py --rig lab.toml --over profile.scale=0:1 --cost metabolic.tsv
"""
OTHERS = ("no_record", "report", "profile")  # options of `run` that do not apply
SETTLE, MEASURE = 60.0, 120.0  # s
GENERATIONS, REST = 4, 5.0  # min


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code of the run; raises BadInput for an optimisation that cannot begin."""
    from runtime.session.request import Request

    parser = Parser("optimise", DESCRIPTION, EPILOG)
    own = parser.section("optimisation")
    own.add_argument(
        "--over",
        action="append",
        required=True,
        metavar="NAME=LOW:HIGH",
        help="optimise a live parameter within bounds: profile.scale=0:1 of one leg or, without a leg, of all legs; "
        "=0:1:0.5 begins at 0.5 (default: the value in the diagram). May be repeated",
    )
    own.add_argument("--cost", required=True, metavar="SOURCE", help="cost to minimise, see below")
    add_number(own, "--settle", "seconds", "S", "wait after each change before the measurement", default=SETTLE)
    add_number(own, "--measure", "seconds", "S", "duration of each measurement", default=MEASURE)
    add_number(
        own,
        "--time-constant",
        "seconds",
        "S",
        "fit samples as a first-order response (default: 42 for a cart; the mean for a signal)",
    )
    own.add_argument(
        "--strides", metavar="SIGNAL", help="average a signal over whole strides of this gait phase, from 0 to 1"
    )
    add_number(
        own,
        "--noise",
        "percent of the cost",
        "PERCENT",
        "standard deviation of one measurement, for the forecast of what the protocol resolves (default: that of a "
        "cart; without a forecast for other costs)",
        maximum=100.0,
    )
    own.add_argument("--plan", action="store_true", help="print the duration and the forecast, and end")
    own.add_argument("--optimiser", default="cma", metavar="NAME", help="cma (default), bayesian or random")
    add_count(own, "--population", "evaluations of a generation (default: the optimiser's own)", minimum=2)
    add_count(own, "--generations", "number of generations", default=GENERATIONS)
    add_count(
        own,
        "--reference",
        "evaluations between two measurements of the initial parameters, from which drift is taken out; 0 for none "
        "(default: a generation)",
        minimum=0,
    )
    add_number(own, "--rest-every", "minutes", "MIN", "walking between two rest breaks (default: no breaks)")
    add_number(own, "--rest", "minutes", "MIN", "duration of a rest break", default=REST)
    add_number(own, "--walking-limit", "minutes", "MIN", "walking after which no measurement begins (default: none)")
    own.add_argument(
        "--largest-step",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="limit the change of a parameter from one proposal to the next. May be repeated",
    )
    add_count(
        own,
        "--optimiser-seed",
        "seed of the optimiser and of the order of validation trials",
        default=0,
        maximum=2**53,
        minimum=0,
    )
    add_count(
        own,
        "--validate",
        "at the end, measure the found and the initial parameters N times each, in random order",
        default=0,
        minimum=0,
    )
    own.add_argument(
        "--zero",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="also validate without assistance: a live parameter that switches it off, as in '*/profile.scale=0'",
    )
    own.add_argument("--no-confirm", action="store_true", help="apply proposals without waiting for the key y")
    own.add_argument("--resume", type=Path, metavar="FILE", help="continue from a *.optimisation.json, and extend it")
    add_options(parser, Request, *(name for name in fields_of(Request) if name not in OTHERS), in_sections=True)
    options = parser.parse_args(arguments)
    request = instance(Request, options)
    if options.plan:
        return planned(request, options)
    if options.fast:
        if request.duration is not None:
            raise BadInput("--duration and --fast exclude each other here: the optimisation decides when the run ends")
        replace(request, duration=1.0).check()
        return virtual(request, options)
    request.record = request.record or Path("recordings")
    request.check()
    return live(request, options)


def parameters_of(options: Namespace) -> list[Parameter]:
    """Return the parameters of --over and --largest-step. Raises BadInput."""
    from runtime.experiments.optimisation.parameters import distinct, parse

    parameters = {parameter.name: parameter for parameter in distinct(map(parse, options.over))}
    for name, text in settings(options.largest_step, "--largest-step "):
        if name not in parameters:
            raise BadInput(f"--largest-step {name}={text}: --over has {', '.join(parameters)}")
        try:
            step = float(text)
        except ValueError:
            raise BadInput(f"--largest-step {name}={text}: expected a number above 0") from None
        parameters[name] = replace(parameters[name], largest_step=step)
    return list(parameters.values())


def plan_of(options: Namespace, schedule: Schedule, recorded: Sequence[Column], attended: bool) -> dict[str, Any]:
    """Return the plan of the optimiser process, see runtime.experiments.optimisation.process. Raises BadInput.

    recorded : signals that a cost can use
    attended : whether an operator can press keys
    """
    from runtime.experiments.optimisation import state_file
    from runtime.experiments.optimisation.live_robot import Targets, with_initial
    from runtime.host.live.table import describe, parse

    run_table = parse(describe(schedule)[1])
    parameters = with_initial(parameters_of(options), run_table)
    zero = settings(options.zero, "--zero ")
    Targets(run_table, parameters, zero)
    if zero and not options.validate:
        raise BadInput("--zero needs --validate N: it is a condition of the validation trials")
    cost = cost_plan(options, recorded)
    if not attended and not options.no_confirm:
        raise BadInput(
            "cannot ask for a confirmation of each proposal: standard input is not a terminal. Pass --no-confirm to "
            "apply proposals without it"
        )
    if not attended and cost["kind"] == "typed":
        raise BadInput("--cost typed needs a terminal: standard input is not a terminal")
    about = {
        "diagram": schedule.name,
        "over": [vars(parameter) for parameter in parameters],
        "cost": options.cost,
        "settle": options.settle,
        "measure": options.measure,
        "time constant": options.time_constant,
        "strides": options.strides,
        "optimiser": options.optimiser,
        "seed": options.optimiser_seed,
        "population": options.population,
        "zero": [list(pair) for pair in zero],
        "reference": options.reference,
    }
    state = state_file.first(about, parameters) if options.resume is None else state_file.read(options.resume, about)
    return {
        "state": state,
        "cost": cost,
        "zero": zero,
        "noises": noises(options, cost),
        "generations": options.generations,
        "settings": {
            "settle": options.settle,
            "measure": options.measure,
            "confirm": not options.no_confirm,
            "attended": attended,
            "validations": options.validate,
            "zero": bool(zero),
            "reference": options.reference,
            "rest_every": 60.0 * (options.rest_every or math.inf),
            "rest": 60.0 * options.rest,
            "walking_limit": 60.0 * (options.walking_limit or math.inf),
            "seed": options.optimiser_seed,
        },
    }


def noises(options: Namespace, cost: dict[str, Any]) -> list[float]:
    """Return the standard deviations of one measurement, relative to the cost, for the forecast."""
    from runtime.experiments.optimisation.metabolic import expected_noise

    if options.noise is not None:
        return [options.noise / 100.0]
    if cost["kind"] == "cart":
        return [expected_noise(options.settle, options.measure, cost["time_constant"])]
    return []


def planned(request: Request, options: Namespace) -> int:
    """Print the duration of the protocol, and what it resolves. Returns the exit code."""
    from runtime.experiments.optimisation.optimisers import restore_optimiser
    from runtime.experiments.optimisation.planner import NOISES, expectation
    from runtime.experiments.optimisation.protocol import Settings
    from runtime.session.prepare import prepare

    schedule = prepare(request).schedule
    plan = plan_of(options, schedule, schedule.recorded, attended=True)
    plan["noises"] = plan["noises"] or NOISES
    settings = Settings.of(plan, restore_optimiser(plan["state"]["optimiser"]).population)
    print_lines([*settings.schedule(), *expectation(plan)])
    return OK


def cost_plan(options: Namespace, recorded: Sequence[Column]) -> dict[str, Any]:
    """Return the part of the plan on the cost. Raises BadInput."""
    from runtime.experiments.optimisation.metabolic import TIME_CONSTANT, too_short
    from runtime.host.suggestions import suggestion

    kind, colon, name = options.cost.partition(":")
    cart = options.cost != "typed" and not (colon and kind == "signal")
    constant = options.time_constant or (TIME_CONSTANT if cart else None)
    if constant is not None and too_short(options.settle, options.measure, constant):
        raise BadInput(
            f"--measure {options.measure:g}: too short to estimate the steady state of a response with a time constant "
            f"of {constant:g} s: measure for {constant:g} s or longer"
        )
    if kind != "signal" or not colon:
        if options.strides is not None:
            raise BadInput("--strides applies to --cost signal:NAME only")
        if options.cost == "typed":
            return {"kind": "typed"}
        return {"kind": "cart", "name": options.cost, "time_constant": constant}
    if options.strides is not None and options.time_constant is not None:
        raise BadInput("--strides and --time-constant exclude each other")
    columns = {column.path: column for column in recorded}
    for option, path in (("--cost signal:", name), ("--strides ", options.strides)):
        if path is not None and path not in columns:
            hint = suggestion(path, columns) or "record it with a CsvRecorder"
            raise BadInput(f"{option}{path}: there is no recorded signal {path!r}; {hint}")
    signals = [columns[path] for path in (name, options.strides) if path is not None]
    return {
        "kind": "signal",
        "name": name,
        "unit": signals[0].unit,
        "columns": [column.index for column in signals],
        "time_constant": options.time_constant,
    }


def live(request: Request, options: Namespace) -> int:
    """Optimise in real time. Returns the exit code of the run."""
    from runtime.cli.run import carry_out_session
    from runtime.experiments.optimisation.recorder import OptimisedRecorder
    from runtime.record.recorder import await_files, can_ask
    from runtime.record.report import summary
    from runtime.session.prepare import prepare
    from runtime.session.session import Session

    prepared = prepare(request)
    plan = plan_of(options, prepared.schedule, prepared.schedule.recorded, can_ask())
    print_to_stderr(map(str, prepared.schedule.warnings))
    resumed = None if options.resume is None else os.fspath(options.resume)
    recorder = partial(OptimisedRecorder, optimiser_plan=plan, state_path=resumed)
    result = carry_out_session(Session(prepared, print_to_stderr, recorder=recorder))
    print_lines(summary.summary(result))
    print_lines([*outcome(result.recording["state"]), *comparison(result, options.measure)])
    await_files(result.recording)
    return summary.exit_code(result.outcome, summary.unsaved_in_words(result))


def comparison(result: Result, measure: float) -> list[str]:
    """Return the command that draws the conditions of a recording over the gait cycle; no line without strides.

    measure : duration of each measurement in s
    """
    from runtime.experiments.optimisation.intervals import of_conditions

    files = [file["path"] for file in result.recording.get("files", [])]
    recording, sidecar = (next((path for path in files if path.endswith(kind)), None) for kind in (".mcap", ".json"))
    if recording is None or sidecar is None or not any(each["strides"] for each in result.recording["strides"]):
        return []
    events = json.loads(Path(sidecar).read_text())["events"]
    conditions = of_conditions(events, result.schedule.rate, measure)
    if len(conditions) < 2:
        return []
    options = " ".join(f"--between {begin:.0f} {end:.0f}" for begin, end in conditions.values())
    command = f"{program()} plot {shlex.quote(recording)} --strides {options}"
    return [f"compare {', '.join(conditions)} over the gait cycle: {command}"]


def virtual(request: Request, options: Namespace) -> int:
    """Optimise on the simulated wearer in virtual time. Returns the exit code."""
    from runtime.experiments.optimisation.virtual import optimise
    from runtime.robot.loading.recorded_signals import PLANT

    options.no_confirm = True
    signals = [name.removeprefix("signal:") for name in (options.cost, options.strides or "")]
    path = optimise(
        request,
        lambda schedule, recorded: plan_of(options, schedule, recorded, attended=False),
        options.resume,
        [name.removeprefix(PLANT) for name in signals if name.startswith(PLANT)],
    )
    print_lines(outcome(path))
    return OK


def outcome(path: str) -> list[str]:
    """Return lines on the state file and its picture."""
    from runtime.experiments.optimisation.picture import write

    finished = json.loads(Path(path).read_text())["finished"]
    lines = [f"optimisation: {path}" + f"; --resume {path} continues" * (not finished)]
    try:
        return lines + write(path)
    except OSError as error:
        return [*lines, f"no picture: {error.strerror or error}"]
