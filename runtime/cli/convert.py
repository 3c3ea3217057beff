"""`convert RECORDING...`: write recordings in other formats."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from runtime.cli.parsing import Parser, add_number
from runtime.cli.reading import read
from runtime.host.console.progress import Progress
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.errors import CHECK_FAILED, OK, BadInput
from runtime.host.optional_dependencies import MissingExtra
from runtime.host.suggestions import suggestion
from runtime.record.analysis.trial import Trial
from runtime.record.export import FORMATS, OPENSIM, convert, opensim
from runtime.record.storage.files import make_folder
from runtime.record.storage.parts import heads
from runtime.record.storage.repair import RepairFailed, finish

READING_SHARE = 0.5  # of the progress


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code, 1 for a damaged or cut recording; raises BadInput for unusable arguments.

    A recording that cannot be converted is reported, and the others are converted.
    """
    parser = Parser(
        "convert",
        "Write recordings in other formats: every sample of every signal, in order. "
        "--to mcap joins and completes the files of a recorder that was killed.",
    )
    parser.add_argument("recordings", type=Path, nargs="+", metavar="RECORDING", help="the .mcap file of a recording")
    parser.add_argument("--to", type=formats, metavar="FORMAT,...", help=f"formats: {', '.join(FORMATS)}")
    parser.add_argument(
        "--opensim", action="store_true", help="write .sto with all signals and .mot with the joint angles"
    )
    add_number(parser, "--rate", "Hz", "HZ", "resample to this rate, with the interpolation of each kind of signal")
    parser.add_argument(
        "--names",
        type=Path,
        metavar="FILE",
        help="for sto and mot: a TOML file of OpenSim coordinates with lines such as "
        '"left/knee.position" = "knee_angle_l"',
    )
    parser.add_argument(
        "--in-place", action="store_true", help="with --to mcap: complete the files in place instead of writing copies"
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="folder to write to (default: beside the recording)"
    )
    options = parser.parse_args(arguments)
    kinds = [*(options.to or ()), *(OPENSIM if options.opensim else ())]
    if not kinds:
        raise BadInput(f"no format given: pass --to {'|'.join(FORMATS)} or --opensim")
    if "mcap" in kinds and options.rate is not None:
        raise BadInput("--to mcap does not resample: use --rate with the other formats")
    if options.in_place and (kinds != ["mcap"] or options.output is not None):
        raise BadInput("--in-place requires --to mcap and excludes other formats and -o")
    if options.names is not None and not set(kinds) & set(OPENSIM):
        raise BadInput("--names requires an OpenSim format: add --to sto, --to mot or --opensim")
    if options.output is not None and options.output.suffix[1:] in FORMATS and not options.output.is_dir():
        raise BadInput(f"-o {options.output}: expected a folder; the files in it have the name of the recording")
    names = None if options.names is None else (opensim.read_names(options.names), options.names)
    code = OK
    for recording in heads(options.recordings):
        try:
            with Progress(f"{'finishing' if options.in_place else 'converting'} {recording.name}") as progress:
                trial = read(recording, progress, 0.0, READING_SHARE)
                if trial.trouble and not trial.unfinished:
                    code = max(code, CHECK_FAILED)
                for path in (
                    complete_files(trial, progress)
                    if options.in_place
                    else convert_recording(trial, dict.fromkeys(kinds), options.rate, options.output, names, progress)
                ):
                    progress.terminal.erase()
                    print_lines([path])
        except MissingExtra:  # no recording can be converted
            raise
        except BadInput as error:
            print_to_stderr([f"tickwork: {error}"])
            code = error.code
    return code


def formats(text: str) -> list[str]:
    """Convert the text of --to. Raises BadInput."""
    kinds = [word.strip().lstrip(".").lower() for word in text.split(",") if word.strip()]
    known = list(FORMATS)
    for kind in kinds:
        if kind not in known:
            hint = suggestion(kind, known) or f"the formats are {', '.join(known)}"
            raise BadInput(f"--to {text}: there is no format {kind!r}; {hint}")
    return kinds


def convert_recording(
    trial: Trial,
    kinds: dict[str, None],
    rate: float | None,
    folder: Path | None,
    names: tuple[dict[str, str], Path] | None,
    progress: Progress,
) -> Iterator[str]:
    """Convert one recording and yield the paths of the files. No file is written if a format cannot hold it.

    names : coordinates and the path of their file, or None
    """
    recording = trial.path
    if rate is not None:
        trial = trial.resample(rate)
    if names is not None:
        trial = opensim.rename_signals(trial, *names)
    for kind in kinds:
        FORMATS.load(kind).check(trial, kind)
    stem = str((folder or recording.parent) / recording.stem)
    for place, kind in enumerate(kinds):
        step = (1.0 - READING_SHARE) / len(kinds)
        try:
            if folder is not None:
                make(folder)
            path = convert(
                trial, kind, stem, progress.part(READING_SHARE + place * step, READING_SHARE + (place + 1) * step)
            )
        except OSError as error:
            raise BadInput(f"cannot write {stem}.{kind}: {error.strerror or error}") from None
        if kind in OPENSIM and (lines := opensim.remarks(trial, path)):
            progress.terminal.erase()
            print_to_stderr([f"tickwork: {line}" for line in lines])
        yield path


def complete_files(trial: Trial, progress: Progress) -> Iterator[Path]:
    """Complete the files of one recording in place and yield their paths."""
    for path in trial.parts:
        try:
            finish(path, progress.part(READING_SHARE, 1.0))
        except RepairFailed as error:
            raise BadInput(str(error)) from None
        except OSError as error:
            raise BadInput(f"cannot finish {path}: {error.strerror or error}") from None
        yield path


def make(folder: Path) -> None:
    """Create a folder. Raises BadInput if a file has its name."""
    try:
        make_folder(folder)
    except (FileExistsError, NotADirectoryError):
        raise BadInput(f"cannot write into {folder}: it is a file, not a folder") from None
