"""`replay RECORDING`: run a recording again."""

from collections.abc import Sequence
from pathlib import Path

from runtime.cli.parsing import Parser
from runtime.host.console.terminal import one_line, print_lines
from runtime.host.errors import CHECK_FAILED, FAULT, OK
from runtime.host.options import folder
from runtime.record.report.replay import text
from runtime.session.replay import open_recording, replay
from runtime.session.replay_source import source_of

WIDTH = 80  # characters of a table


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code: 1 if the replay differs; 3 at a fault, if that was sought."""
    parser = Parser(
        "replay", "Run a recording again from its received frames, on the recorded clock, without hardware."
    )
    parser.add_argument("recording", type=Path, metavar="RECORDING", help="the .mcap file of a recording")
    parser.add_argument(
        "--diagram",
        type=Path,
        metavar="FILE",
        help="run this diagram file (default: the recorded file if its content is unchanged, "
        "else the diagram in the recording)",
    )
    parser.add_argument(
        "--record", type=folder, metavar="DIR", help="write the new recording to this folder (default: it is not kept)"
    )
    parser.add_argument(
        "--until-fault",
        action="store_true",
        help="stop where the run has ended, and print the inputs and outputs of the block that has caused it in the "
        "newest ticks; the exit code is 3 if that is a fault",
    )
    options = parser.parse_args(arguments)
    trial = open_recording(options.recording)
    source = source_of(trial, options.diagram)
    if source.sha256 is not None:  # named by the recording, not by the operator
        print_lines([one_line(f"running {source.file}: its content is the recorded one")])
    result = replay(trial, source, options.record, WIDTH if options.until_fault else None)
    print_lines(map(one_line, text(result)))
    if not result.same:
        return CHECK_FAILED
    return FAULT if options.until_fault and result.faulted else OK
