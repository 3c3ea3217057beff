"""`python -m runtime FILE`, or `run FILE`: run a diagram."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from runtime.cli.parsing import Parser, add_options, fields_of, instance
from runtime.host.console.styles import console_for
from runtime.host.console.terminal import print_lines, print_to_stderr, program, reopen_streams
from runtime.host.errors import BadInput

if TYPE_CHECKING:
    from runtime.session.request import Request
    from runtime.session.result import Result
    from runtime.session.session import Session


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code of the run, as in runtime.record.report.summary.exit_code."""
    from runtime.record.recorder import await_files
    from runtime.record.report import summary

    result = carry_out(parse_run(arguments))
    if result.request.report is not None:
        with suppress(BrokenPipeError), open(result.request.report, "w") as pipe:
            pipe.write(json.dumps({"files": result.recording.get("files", [])}) + "\n")
    print_lines(summary.summary(result))
    if result.request.profile and not result.outcome.faulted:
        print_lines(profile_lines(result))
    if not result.outcome.faulted and result.request.report is None:
        print_lines(summary.hints(result, program()))
    await_files(result.recording)
    return summary.exit_code(result.outcome, summary.unsaved_in_words(result))


def carry_out(request: Request) -> Result:
    """Carry out a run and print its problems. Returns its Result."""
    from runtime.record.recorder import RecorderProcess

    # it starts on another processor while this one imports the compiler, loads the diagram and compiles it
    waiting = None if request.fast else RecorderProcess()
    try:
        from runtime.session.prepare import prepare
        from runtime.session.session import Session

        prepared = prepare(request)
        print_to_stderr(map(str, prepared.warnings))
        return carry_out_session(Session(prepared, print_to_stderr, waiting=waiting))
    finally:
        if waiting is not None:
            waiting.dismiss()


def carry_out_session(session: Session) -> Result:
    """Carry out a Session and print its problems. Returns its Result."""
    from runtime.host.machine.realtime import RealtimeRefused
    from runtime.record.recorder import RecorderError
    from runtime.record.report import summary

    try:
        result = session.carry_out()
    except (RealtimeRefused, RecorderError) as error:
        raise BadInput(str(error)) from None
    reopen_streams()
    if result.outcome.faulted:
        console = console_for(sys.stderr)
        print_to_stderr(piece for line in result.report for piece in console.fold(line))
    elif (reason := summary.stop_reason(result.outcome) or result.session_over) is not None:
        print_to_stderr([reason])
    return result


def profile_lines(result: Result) -> list[str]:
    """Return the lines of the profile of a run."""
    from cext.clock.stopwatch import time_of_lap
    from runtime.record.report.profile import table

    return table(result, time_of_lap())


def parse_run(arguments: Sequence[str]) -> Request:
    """Convert the arguments of a run to a Request. Raises BadInput."""
    from runtime.session.request import Request

    parser = Parser("run", "Run a diagram: in simulation, or with --rig on hardware.")
    add_options(parser, Request, *fields_of(Request), in_sections=True)
    request = instance(Request, parser.parse_args(arguments))
    request.check()
    return request
