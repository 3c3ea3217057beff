"""Performance goals. The functions compare them with the data of a Report: the JSON document of a command."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from runtime.host.console.terminal import print_lines
from runtime.setup.bench.report import Report
from tests.bench.starting import IMPORTS
from tests.bench.views_process import ALL, NONE

CHAIN_NS = {"native blocks": 5.0, "Python blocks": 150.0}  # ns per block
COMPILE_MS = 20.0  # ms, 200 blocks
START_RATIO = 1.5  # times the import of the libraries that a run needs
MEMORY_MB = 60.0  # MB
CLOCK_RATIO = {"native": 1.3, "python": 2.0, "disturbed": 2.0}  # times the C loop
RECORDED_US = 0.2  # µs per tick, 60 signals
HISTOGRAM_ADD_NS = 5.0  # ns
DRIFT_NS = 1.0  # ns
GROWTH_MIB = 1.0  # MiB
KNEE_MINUTE_S = 0.2  # s of loop time for 60 s in virtual time
RECORDER_US = 12.0  # µs per tick, 36 signals and 4 frames, MCAP and CSV
BUS_US = 1.0  # µs per tick in addition to two system calls
GUARDIAN_US = 100.0  # µs added to a round trip, p99
DRIVES_US = 5.0  # µs per tick for eight drives, without system calls
STOP_MS = 20.0  # ms from kill -9, p99
SENSORS_SHARE = 0.1  # of one processor, for eight sensors at 500 Hz
LATENESS_BESIDE_SENSORS_RATIO = 1.5  # times the lateness of the loop alone
PARSER_MB_S = 200.0  # MB/s
PARSER_OVER_PYTHON_RATIO = 10.0
GAIT_ESTIMATORS = ("thigh: Kalman", "shank: Kalman", "knee: Kalman")
GAIT_TIMING_MS = 15.0  # ms, median
GAIT_PHASE_PERCENT = {"steady": 1.5, "sine": 2.5, "steps": 5.0}  # % of a stride, RMS
ROS2_ADDED_MS = 1.0  # ms from the tick to the call of Zenoh, p99
LATENESS_WITH_VIEWS_RATIO = 1.5  # times the lateness without viewers, p99


@dataclass(frozen=True)
class Goal:
    """One goal.

    what : measured quantity
    value, bound : measured value and goal, in `unit`
    at_least : whether the bound is a minimum
    """

    what: str
    value: float
    bound: float
    unit: str
    at_least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the measured value meets the goal."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def of_blocks(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of a chain of blocks and of compiling."""
    rows, compiled = data["chain"]["us_a_tick"], data["compile"]
    smallest = compiled["rows"][0]
    return [
        *(
            Goal(f"a chain, {name}", rows[name]["ns_a_block"], bound, "ns per block")
            for name, bound in CHAIN_NS.items()
        ),
        Goal(f"compile {smallest['blocks']} blocks", smallest["compile_ms"]["median"], COMPILE_MS, "ms"),
        Goal("growth of the compile time, p in blocks^p", compiled["exponent"], compiled["n_log_n"], ""),
    ]


def of_start(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of a start."""
    run, imports = data["start"]["run"], data["start"][f"import {IMPORTS}"]
    ratio = run["ms"]["median"] / imports["ms"]["median"]
    return [
        Goal(f"to the first tick, over import {IMPORTS}", ratio, START_RATIO, "times"),
        Goal("resident memory of the control process", run["resident_mb"], MEMORY_MB, "MB"),
    ]


def of_clock(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of the clock, and of the parts of a tick where the clock was not disturbed."""
    disturbed = "costs" not in data
    goals, rows = [], iter(data["clock"].items())
    for (name, reference), (_, native), (_, python) in zip(rows, rows, rows, strict=True):
        rate = name.partition(",")[0]
        bound = CLOCK_RATIO["disturbed" if disturbed else "native"]
        ratio = native["period_p99_us"] / reference["period_p99_us"]
        goals.append(Goal(f"{rate}, |period-T| p99 over C", ratio, bound, "times"))
        if disturbed:
            lost = max(0, native["missed"] - reference["missed"])
            goals.append(Goal(f"{rate}, ticks lost in excess of the C loop", lost, 0, ""))
        else:
            late = native["late_p50_us"] / reference["late_p50_us"]
            goals.append(Goal(f"{rate}, late p50 over C", late, bound, "times"))
            slower = python["period_p99_us"] / reference["period_p99_us"]
            goals.append(Goal(f"{rate}, ten Python blocks, p99 over C", slower, CLOCK_RATIO["python"], "times"))
    return goals if disturbed else goals + of_costs(data["costs"])


def of_costs(results: dict[str, float]) -> list[Goal]:
    """Return the goals of the parts of a tick and of the recorder. results : {name with its unit: value}"""
    return [
        Goal("60 recorded signals", results["recorded_signals_us"], RECORDED_US, "µs per tick"),
        Goal("adding to a histogram", results["histogram_add_ns"], HISTOGRAM_ADD_NS, "ns"),
        Goal("drift over 10^9 grid points", results["drift_ns"], DRIFT_NS, "ns"),
        Goal("growth of resident memory", results["growth_mib"], GROWTH_MIB, "MiB"),
        Goal("60 s of knee_exo, loop time", results["knee_minute_s"], KNEE_MINUTE_S, "s"),
        Goal("recorder, MCAP and CSV", results["recorder_csv_us"], RECORDER_US, "µs per tick"),
    ]


def of_bus(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of a bus and of the guardian."""
    results = data["bus"]
    return [
        Goal("a bus, without its two system calls", results["beyond_us"]["p50"], BUS_US, "µs per tick"),
        Goal("the guardian, added to p99 of a round trip", results["added_p99_us"], GUARDIAN_US, "µs"),
    ]


def of_deaths(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of the deaths of processes."""
    results = data["deaths"]
    killed = {name: each for name, each in results.items() if "killed" in name}
    return [
        *(Goal(f"{name}, p99", each["p99"], STOP_MS, "ms") for name, each in killed.items()),
        Goal("deaths without stop frames", sum(each["missed"] for each in results.values()), 0, ""),
    ]


def of_can(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of drives on CAN."""
    results = data["can"]
    return [
        Goal("eight drives, without system calls", results["native_us"]["p50"], DRIVES_US, "µs per tick"),
        Goal(
            "answers missed in excess of the C loop",
            max(0, results["motors"]["tickwork"]["unanswered"] - results["motors"]["c"]["unanswered"]),
            0,
            "",
        ),
    ]


def of_sensors(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of inertial sensors."""
    results = data["sensors"]
    return [
        Goal("eight sensors, share of one processor", results["processor"], SENSORS_SHARE, ""),
        Goal("packets lost or corrupt", results["lost"] + results["corrupt"] + results["overflows"], 0, ""),
        Goal(
            "late p99 with them over the loop alone",
            results["late_p99_us"]["beside"] / results["late_p99_us"]["alone"],
            LATENESS_BESIDE_SENSORS_RATIO,
            "times",
        ),
        Goal("MIP, native parser", results["native_mb_s"], PARSER_MB_S, "MB/s", True),
        Goal(
            "native parser over the parser in Python",
            results["native_mb_s"] / results["python_mb_s"],
            PARSER_OVER_PYTHON_RATIO,
            "times",
            True,
        ),
    ]


def of_views(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of recorders and viewers."""
    alone, viewed = (data["views"][name]["late_p99_us"] for name in (NONE, ALL))
    return [
        Goal("all viewers on, lateness p99", viewed / alone, LATENESS_WITH_VIEWS_RATIO, "times"),
        Goal("all viewers on, records dropped", data["dropped"], 0, "records"),
    ]


def of_gait(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of the estimators that need no contact, worst leg."""
    goals, legs = [], [each["estimators"] for each in data["gait"]]
    for name in GAIT_ESTIMATORS:
        rows = [leg[name] for leg in legs if name in leg]
        if not rows:
            continue
        lost = max(row["steady"]["missed"] + row["steady"]["invented"] for row in rows)
        goals.append(Goal(f"{name}, steady: missed and invented", lost, 0.0, "strikes"))
        goals.append(
            Goal(f"{name}, steady: timing", max(row["steady"]["median_ms"] for row in rows), GAIT_TIMING_MS, "ms")
        )
        for condition, bound in GAIT_PHASE_PERCENT.items():
            worst = max(row[condition]["phase_rms_percent"] for row in rows)
            goals.append(Goal(f"{name}, {condition}: phase", worst, bound, "% RMS"))
    return goals


def of_ros2(data: dict[str, Any]) -> list[Goal]:
    """Return the goals of the bridge to ROS 2."""
    added = data["ros2"]["a run: grid time to put"]["p99_ms"]
    return [Goal("from the tick to the call of Zenoh, p99", added, ROS2_ADDED_MS, "ms")]


GOALS: dict[str, Callable[[dict[str, Any]], list[Goal]]] = {
    "blocks": of_blocks,
    "bus": of_bus,
    "can": of_can,
    "clock": of_clock,
    "deaths": of_deaths,
    "gait": of_gait,
    "ros2": of_ros2,
    "sensors": of_sensors,
    "start": of_start,
    "views": of_views,
}


def finish(report: Report, goals: list[Goal]) -> None:
    """Print goals below the tables of a report, or the JSON document with them."""
    if report.as_json:
        report.data["goals"] = [
            {
                "what": goal.what,
                "value": goal.value,
                "goal": goal.bound,
                "unit": goal.unit,
                "at_least": goal.at_least,
                "reached": goal.reached,
            }
            for goal in goals
        ]
        report.finish()
        return
    lines = ["", f"{'goals':46}{'measured':>12}{'goal':>18}"]
    for goal in goals:
        bound = f"{'at least' if goal.at_least else 'at most'} {goal.bound:.3g}"
        lines.append(
            f"  {goal.what:44}{goal.value:12.3g}{bound:>18} "
            f"{goal.unit:12}{'' if goal.reached else 'not reached'}".rstrip()
        )
    print_lines(lines)
