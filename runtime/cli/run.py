"""`python -m runtime FILE`, or `run FILE`: run a diagram."""

from graph.units import parse_quantity
from runtime.base.errors import BadInput
from runtime.cli.parsing import (
    LONGEST,
    Parser,
    add_bitrate,
    add_diagram,
    add_pace,
    add_rig,
    count,
    folder,
    host_and_port,
    number,
    processor,
    rerun_target,
    settings,
    trial,
)
from runtime.console.terminal import complain, program, tell


def main(arguments):
    from runtime.report import summary

    result = carried_out(parse_run(arguments))
    tell(summary.summary(result))
    if result.request.profile and not result.outcome.faulted:
        tell(profiled(result))
    if not result.outcome.faulted:
        tell(summary.hints(result, program()))
    return summary.exit_code(result.outcome)


def carried_out(request):
    """The Result of a run, with what went wrong told."""
    from runtime.machine.realtime import RealtimeRefused
    from runtime.recorder import RecorderError
    from runtime.report import summary
    from runtime.session.run import prepare, run

    prepared = prepare(request)
    complain(map(str, prepared.schedule.warnings))
    try:
        result = run(prepared, complain)
    except (RealtimeRefused, RecorderError) as error:
        raise BadInput(str(error)) from None
    if result.outcome.faulted:
        complain(result.report)
    elif summary.stopped(result.outcome):
        complain([summary.stopped(result.outcome)])
    return result


def profiled(result):
    from cext.clock.stopwatch import time_of_lap
    from runtime.report.profile import table

    return table(result, time_of_lap())


def poses(texts, rig):
    """{path: rad} of --pose. BadInput"""
    if texts and rig is None:
        raise BadInput("--pose is for a rig: in simulation every drive reads where its joint stands")
    found = {}
    for text in texts:
        path, _, angle = text.partition("=")
        try:
            found[path] = parse_quantity(angle, "rad")
            if not abs(found[path]) < float("inf"):
                raise ValueError("an angle is a finite number")
        except ValueError as error:
            raise BadInput(
                f"--pose {text}: {error}; write PATH=ANGLE, as in left/knee=0 or 'left/knee=30 deg'"
            ) from None
    return found


def parse_run(arguments):
    """Command-line words to a Request. BadInput says which is wrong."""
    from runtime.machine.realtime import MODES, PRIORITY, PRIORITY_LIMIT
    from runtime.session.run import Request

    parser = Parser("run", "Run a diagram: in simulation, or with --rig on real hardware.")
    add_diagram(parser)
    add_rig(parser)
    parser.add_argument(
        "--duration",
        type=number("--duration", "seconds", LONGEST),
        metavar="S",
        help="stop after S seconds (default: Ctrl-C)",
    )
    parser.add_argument(
        "--fast", action="store_true", help="virtual time: as fast as the machine can (needs --duration)"
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--record", type=folder, metavar="DIR", help="folder of the recording (default: recordings)")
    where.add_argument("--no-record", action="store_true", help="write no files")
    parser.add_argument(
        "--trial",
        nargs="+",
        default=[],
        metavar="NAME=VALUE",
        help="what this trial is: subject=S03 condition=assist notes='new shoes'",
    )
    parser.add_argument("--plotjuggler", type=host_and_port, metavar="HOST:PORT", help="where PlotJuggler listens")
    parser.add_argument(
        "--rerun",
        nargs="?",
        const="",
        type=rerun_target,
        metavar="WHERE",
        help="show it in Rerun's viewer; or WHERE: a FILE.rrd, serve for a browser, HOST:PORT of a viewer elsewhere",
    )
    parser.add_argument(
        "--realtime",
        choices=MODES,
        help="ask the system for real-time priority, locked memory and processors that stay awake: "
        "try takes what is "
        "granted and tells of the rest, require does not start without (default: try on a rig, "
        "off in simulation)",
    )
    parser.add_argument(
        "--priority",
        type=count("--priority", PRIORITY_LIMIT),
        metavar="N",
        help=f"of SCHED_FIFO, 1 to {PRIORITY_LIMIT} (default: {PRIORITY})",
    )
    parser.add_argument(
        "--cpu",
        type=processor,
        metavar="N",
        help="stay on this processor (default: the last isolated one; else, with real-time priority, "
        "one that no other run has)",
    )
    parser.add_argument("--yes", action="store_true", help="on a rig: arm without waiting for Enter")
    parser.add_argument(
        "--pose",
        action="append",
        default=[],
        metavar="PATH=ANGLE",
        help="on a rig: where a joint stands, as seen, not as its drive reads: left/knee=0 or "
        "'left/knee=30 deg'. Repeat it for more",
    )
    parser.add_argument(
        "--rearm",
        action="store_true",
        help="after a fault, wait in the safe stop until the key r arms again and nothing stands in the way",
    )
    add_pace(parser)
    add_bitrate(parser, "of the simulated buses: frames take the time that their bits take (default: they take none)")
    parser.add_argument(
        "--profile", action="store_true", help="time every block, and tell at the end where the time of a tick goes"
    )
    options = parser.parse_args(arguments)
    if options.bitrate is not None and options.rig is not None:
        raise BadInput("--bitrate and --rig exclude each other: the rig file says what a real bus runs at")
    if options.fast and options.rig is not None:
        raise BadInput("--fast and --rig exclude each other: on a rig time is real")
    options.realtime = options.realtime or ("off" if options.rig is None else "try")
    if options.fast and options.rearm:
        raise BadInput("--fast and --rearm exclude each other: nobody is quick enough to press r in virtual time")
    if options.fast and options.duration is None:
        raise BadInput("--fast needs --duration S: virtual time ends when that has passed")
    if options.fast and options.realtime != "off":
        raise BadInput(f"--realtime {options.realtime} and --fast exclude each other: virtual time waits for nothing")
    for name in ("priority", "cpu"):
        if options.realtime == "off" and getattr(options, name) is not None:
            raise BadInput(f"--{name} needs --realtime try or --realtime require")
    return Request(
        file=options.file,
        rig=options.rig,
        rate=options.rate,
        duration=options.duration,
        fast=options.fast,
        settings=settings(options.settings),
        record=options.record,
        no_record=options.no_record,
        plotjuggler=options.plotjuggler,
        rerun=options.rerun,
        trial=trial(options.trial),
        realtime=options.realtime,
        priority=options.priority or PRIORITY,
        cpu=options.cpu,
        overrun=options.overrun,
        spin=options.spin,
        profile=options.profile,
        yes=options.yes,
        rearm=options.rearm,
        poses=poses(options.pose, options.rig),
        bitrate=options.bitrate,
    )
