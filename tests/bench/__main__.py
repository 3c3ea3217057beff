"""Measure the performance of Tickwork, and compare it with its goals: `python -m tests.bench NAME [options]`.

blocks      ticks of native and Python blocks, and compiles
bus         cost of a bus and of the guardian
can         cost of eight drives per tick, and replies lost at 1000 Hz
clock       lateness of the loop, compared with a C loop; costs of parts of a tick
deaths      time to the stop after the death of each process of a run
gait        errors of the gait estimators on recorded walking
ros2        time from the tick to a subscriber of ROS 2, and of bare Zenoh
sensors     cost of eight inertial sensors on serial lines
start       start-up time and memory
views       lateness of the loop with every recorder and viewer on
"""

import sys
from importlib import import_module

from runtime.host.errors import BAD_INPUT, OK, BadInput
from tests.bench.c_program import NoCompiler
from tests.bench.goals import GOALS, finish

PRODUCT = {"blocks": "command", "bus": "bus", "gait": "gait"}  # commands of `python -m runtime bench`: their modules


def main(arguments: list[str]) -> int:
    """Run a command. Returns the exit code."""
    name, *rest = arguments or ["--help"]
    if name not in GOALS:
        print(__doc__, end="")
        return OK if name in ("-h", "--help") else BAD_INPUT
    module = f"runtime.cli.bench.{PRODUCT[name]}" if name in PRODUCT else f"tests.bench.commands.{name}"
    try:
        report = import_module(module).measure_and_print(rest)
    except (BadInput, NoCompiler) as error:
        print(f"tests.bench: {error}", file=sys.stderr)
        return BAD_INPUT
    finish(report, GOALS[name](report.data))
    return OK


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
