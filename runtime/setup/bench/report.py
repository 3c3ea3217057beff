"""Output of `bench`: tables, or one JSON document."""

from __future__ import annotations

import json
import math
import os
import platform
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from runtime.host.console.terminal import print_lines
from runtime.host.errors import BadInput

if TYPE_CHECKING:
    import numpy as np


def machine() -> dict[str, Any]:
    """Return the Python version and the machine, for the JSON document."""
    return {"python": platform.python_version(), "machine": platform.machine(), "processors": os.cpu_count()}


def machine_lines() -> list[str]:
    """Return the line on the Python version and the machine."""
    return ["Python {python} on {machine}, {processors} processors".format(**machine())]


def spread(values: np.ndarray) -> dict[str, float]:
    """Return {"p50", "p99", "max"} of values, infinite where there are none."""
    import numpy as np

    if not len(values):
        return dict.fromkeys(("p50", "p99", "max"), math.inf)
    return {
        "p50": float(np.percentile(values, 50)),
        "p99": float(np.percentile(values, 99)),
        "max": float(values.max()),
    }


def lateness(counts: np.ndarray, share: float) -> float:
    """Return the time in s that this share of the ticks does not exceed. Raises BadInput without a tick.

    counts : as returned by cext.clock.histogram.counts_of
    """
    from cext.clock.histogram import percentile

    if not counts.any():
        raise BadInput("no tick ran in time to be measured: end other programs, or pass a longer --seconds")
    return percentile(counts, share)


def row(name: str, results: dict[str, float]) -> str:
    """Return a line of a table. results : as returned by `spread`"""
    return f"  {name:44}{results['p50']:9.2f}{results['p99']:9.2f}{results['max']:9.2f}"


class Report:
    """Printer of tables.

    as_json : whether to collect everything and print one JSON document at the end
    """

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self.data = {}

    def say(self, lines: Sequence[str], **data: Any) -> None:
        """Print lines, or collect data for the JSON document.

        data : {key of the document: value}
        """
        self.data |= data
        if not self.as_json:
            print_lines(lines)

    def finish(self) -> None:
        """Print the JSON document, if one was requested."""
        if self.as_json:
            print_lines([json.dumps(self.data, indent=1, ensure_ascii=False)])
