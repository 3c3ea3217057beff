"""Performance goals and the measured values to compare with them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from runtime.setup.bench.blocks import Compiles
    from runtime.setup.bench.clock import Kept
    from runtime.setup.bench.measure import Times

CHAIN_NS = {"native blocks": 5.0, "Python blocks": 150.0}  # ns per block
COMPILE_MS = 20.0  # ms, 200 blocks
START_MS = 450.0  # ms
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


def of_blocks(rows: dict[str, dict[str, float]]) -> list[Goal]:
    """Return the goals of a chain of blocks. rows : rows as returned by measure.table"""
    return [
        Goal(f"a chain, {name}", rows[name]["ns_a_block"], bound, "ns per block") for name, bound in CHAIN_NS.items()
    ]


def of_compiles(compiles: Sequence[Compiles], exponent: float, n_log_n: float) -> list[Goal]:
    """Return the goals of compiling.

    compiles : values as returned by blocks.compiles, smallest first
    exponent : p of a time that grows as blocks^p
    n_log_n : p of a time that grows as n log n
    """
    return [
        Goal(f"compile {compiles[0].blocks} blocks", compiles[0].compile.median, COMPILE_MS, "ms"),
        Goal("growth of the compile time, p in blocks^p", exponent, n_log_n, ""),
    ]


def of_start(results: dict[str, tuple[Times, Times]]) -> list[Goal]:
    """Return the goals of a start. results : results as returned by starting.measure"""
    times, memory = results["run"]
    return [
        Goal("from process start to the first tick", times.median, START_MS, "ms"),
        Goal("resident memory of the control process", memory.median, MEMORY_MB, "MB"),
    ]


def of_clock(results: dict[int, dict[str, Kept]], disturbed: bool) -> list[Goal]:
    """Return the goals of the clock. results : {rate: {contender: runtime.setup.bench.clock.Kept}}"""
    goals = []
    for rate, contenders in results.items():
        reference, native, python = contenders.values()
        bound = CLOCK_RATIO["disturbed" if disturbed else "native"]
        goals.append(Goal(f"{rate} Hz, |period-T| p99 over C", native.off(0.99) / reference.off(0.99), bound, "times"))
        if disturbed:
            goals.append(
                Goal(f"{rate} Hz, ticks lost in excess of the C loop", max(0, native.missed - reference.missed), 0, "")
            )
        else:
            goals.append(Goal(f"{rate} Hz, late p50 over C", native.late(0.5) / reference.late(0.5), bound, "times"))
            slower = python.off(0.99) / reference.off(0.99)
            goals.append(Goal(f"{rate} Hz, ten Python blocks, p99 over C", slower, CLOCK_RATIO["python"], "times"))
    return goals


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


def of_bus(results: dict[str, Any]) -> list[Goal]:
    """Return the goals of a bus and of the guardian. results : results of the command `bench bus`"""
    return [
        Goal("a bus, without its two system calls", results["beyond_us"]["p50"], BUS_US, "µs per tick"),
        Goal("the guardian, added to p99 of a round trip", results["added_p99_us"], GUARDIAN_US, "µs"),
    ]


def of_deaths(results: dict[str, Any]) -> list[Goal]:
    """Return the goals of the deaths of processes. results : results of the command `bench deaths`"""
    killed = {name: each for name, each in results.items() if "killed" in name}
    return [
        *(Goal(f"{name}, p99", each["p99"], STOP_MS, "ms") for name, each in killed.items()),
        Goal("deaths without stop frames", sum(each["missed"] for each in results.values()), 0, ""),
    ]


def of_can(results: dict[str, dict[str, Any]]) -> list[Goal]:
    """Return the goals of drives on CAN. results : results of the command `bench can`"""
    return [
        Goal("eight drives, without system calls", results["native_us"]["p50"], DRIVES_US, "µs per tick"),
        Goal(
            "answers missed in excess of the C loop",
            max(0, results["motors"]["tickwork"]["unanswered"] - results["motors"]["c"]["unanswered"]),
            0,
            "",
        ),
    ]


def of_sensors(results: Mapping[str, Any]) -> list[Goal]:
    """Return the goals of inertial sensors. results : results as returned by sensors.summary"""
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


def of_views(viewed: Kept, alone: Kept, dropped: int) -> list[Goal]:
    """Return the goals of recorders and viewers. viewed, alone : Kept; dropped : number of records"""
    return [
        Goal("all viewers on, lateness p99", viewed.late(0.99) / alone.late(0.99), LATENESS_WITH_VIEWS_RATIO, "times"),
        Goal("all viewers on, records dropped", dropped, 0, "records"),
    ]


def of_gait(legs: Sequence[dict[str, dict[str, dict[str, float]]]]) -> list[Goal]:
    """Return the goals of the estimators that need no contact, worst leg. legs : {estimator: {condition: errors}}"""
    goals = []
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
