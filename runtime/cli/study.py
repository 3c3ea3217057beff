"""`study STUDY.toml`: run a study and print the range of its objectives."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from runtime.cli.parsing import Parser, add_count, add_options
from runtime.experiments.optimisation import description, simulated
from runtime.experiments.optimisation.description import Optimisation
from runtime.experiments.studies.description import Study, read, read_study
from runtime.experiments.studies.run import journal_of, run
from runtime.host.console.terminal import print_lines, print_to_stderr
from runtime.host.ending import Interrupted
from runtime.host.errors import OK, BadInput
from runtime.session.request import Request

EPILOG = """\
example of a study:
  diagram = "diagrams/knee_exo.py"
  duration = 30                         # s, of each run
  [grid]
  assistance = [0.0, 0.5, 1.0]
  [objectives]
  work = { function = "positive_work", leg = "left" }

instead of [grid], to minimise an objective:
  [optimise]
  over = { assistance = [0.0, 1.0], stride_time = [0.9, 1.3] }
"""


def main(arguments: Sequence[str]) -> int:
    """Run the command. Returns the exit code; raises BadInput for a study that cannot run."""
    parser = Parser(
        "study",
        "Run a diagram in virtual time for grids and samples of parameters, and write the objectives of all runs as "
        "one Parquet table, and a picture of them. With a table [optimise], an optimiser chooses the parameters. A "
        "study that was interrupted continues with the same command.",
        EPILOG,
    )
    parser.add_argument("study", type=Path, metavar="STUDY", help="the TOML file of the study")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="Parquet table (default: the name of the study)"
    )
    add_count(parser, "--workers", "number of processes (default: one for each processor)")
    parser.add_argument("--dask", metavar="ADDRESS", help="run on the workers of this Dask scheduler: tcp://HOST:PORT")
    add_options(parser, Request, "subject", subject={"help": "limits for one person, which no trial exceeds"})
    options = parser.parse_args(arguments)
    study = read(options.study, describe)
    if options.subject is not None:
        if study.subject is not None:
            raise BadInput(f"--subject {options.subject}: {options.study} has a subject file already: {study.subject}")
        study = replace(study, subject=str(options.subject))
    output = options.output or Path(options.study.with_suffix(".parquet").name)
    if output.suffix != ".parquet":
        raise BadInput(f"{output}: the name of the table must end in .parquet")
    try:
        if isinstance(study, Optimisation):
            result = simulated.run(study, output, options.workers, options.dask)
        else:
            result = run(study, output, options.workers, options.dask)
    except Interrupted:
        print_to_stderr([f"tickwork: finished trials are stored in {journal_of(output)}; the same command continues"])
        raise
    pictures = result.plot().save(output.with_suffix(".png"))
    print_lines([*result.summary(), *map(str, (output, *pictures))])
    return OK


def describe(content: Mapping[str, Any]) -> Study:
    """Return the Study of the content of a TOML file, an Optimisation if it has the table [optimise]."""
    return description.read_optimisation(content) if description.TABLE in content else read_study(content)
