"""Speed that Tickwork aims for, beside what was measured."""

from dataclasses import dataclass

CHAIN = {"native blocks": 5.0, "Python blocks": 150.0}  # ns a block
COMPILE = 20.0  # ms, 200 blocks
START = 450.0  # ms
MEMORY = 60.0  # MB
CLOCK = {"native": 1.3, "python": 2.0, "disturbed": 2.0}  # times the C loop
RECORDED = 0.2  # µs a tick, 60 signals
ADD = 5.0  # ns
DRIFT = 1.0  # ns
GROWTH = 1.0  # MiB
KNEE_MINUTE = 0.2  # s
BUS = 1.0  # µs a tick beyond two system calls
GUARDIAN = 100.0  # µs of a round trip, p99
DRIVES = 5.0  # µs a tick of eight drives, beyond the system calls
STOP = 20.0  # ms from kill -9, p99
SENSORS = 0.1  # of one processor: eight at 500 Hz
BESIDE = 1.5  # times the lateness of the loop alone
PARSER = 200.0  # MB/s
OVER_PYTHON = 10.0
VIEWS = 1.5  # times the lateness without any, p99


@dataclass(frozen=True)
class Goal:
    """value and bound in `unit`; at_least : whether more is better"""

    what: str
    value: float
    bound: float
    unit: str
    at_least: bool = False

    @property
    def reached(self):
        return self.value >= self.bound if self.at_least else self.value <= self.bound


def of_blocks(rows):
    """Goals of a chain of blocks. rows : of measure.table"""
    return [Goal(f"a chain, {name}", rows[name]["ns_a_block"], bound, "ns a block") for name, bound in CHAIN.items()]


def of_compiles(compiles, exponent, n_log_n):
    return [
        Goal(f"compile {compiles[0].blocks} blocks", compiles[0].compile.median, COMPILE, "ms"),
        Goal("growth of the compile, p of blocks^p", exponent, n_log_n, ""),
    ]


def of_start(found):
    times, memory = found["run"]
    return [
        Goal("from process start to the first tick", times.median, START, "ms"),
        Goal("resident memory of the control process", memory.median, MEMORY, "MB"),
    ]


def of_clock(found, disturbed):
    """found : {rate: {contender: runtime.bench.clock.Kept}}"""
    goals = []
    for rate, contenders in found.items():
        reference, native, python = contenders.values()
        bound = CLOCK["disturbed" if disturbed else "native"]
        goals.append(Goal(f"{rate} Hz, |period-T| p99 over C", native.off(0.99) / reference.off(0.99), bound, "times"))
        if disturbed:
            goals.append(
                Goal(f"{rate} Hz, ticks lost beyond the C loop's", max(0, native.missed - reference.missed), 0, "")
            )
        else:
            goals.append(Goal(f"{rate} Hz, late p50 over C", native.late(0.5) / reference.late(0.5), bound, "times"))
            slower = python.off(0.99) / reference.off(0.99)
            goals.append(Goal(f"{rate} Hz, ten Python blocks, p99 over C", slower, CLOCK["python"], "times"))
    return goals


def of_costs(found):
    return [
        Goal("60 recorded signals", found["recorded_signals_us"], RECORDED, "µs a tick"),
        Goal("a histogram add", found["histogram_add_ns"], ADD, "ns"),
        Goal("drift over 10^9 grid points", found["drift_ns"], DRIFT, "ns"),
        Goal("growth of resident memory", found["growth_mib"], GROWTH, "MiB"),
        Goal("60 s of knee_exo, loop time", found["knee_minute_s"], KNEE_MINUTE, "s"),
    ]


def of_bus(found):
    return [
        Goal("a bus, beyond its two system calls", found["beyond_us"]["p50"], BUS, "µs a tick"),
        Goal("the guardian, added to p99 of a round trip", found["added_p99_us"], GUARDIAN, "µs"),
        Goal("kill -9 to the last first stop frame, p99", found["stop_ms"]["p99"], STOP, "ms"),
        Goal("kills that no stop frame followed", found["missed"] + found["guardian_deaths_missed"], 0, ""),
        *(
            Goal(f"kill -9 of the guardian to the last first stop frame, p99, {name}", each["p99"], STOP, "ms")
            for name, each in found["guardian_deaths_ms"].items()
        ),
    ]


def of_can(found):
    return [
        Goal("eight drives, beyond the bus's system calls", found["native_us"]["p50"], DRIVES, "µs a tick"),
        Goal(
            "answers missed beyond those of the C loop",
            max(0, found["motors"]["tickwork"]["unanswered"] - found["motors"]["c"]["unanswered"]),
            0,
            "",
        ),
    ]


def of_sensors(found):
    return [
        Goal("eight sensors, of one processor", found["processor"], SENSORS, ""),
        Goal("packets lost or corrupt", found["lost"] + found["corrupt"] + found["overflows"], 0, ""),
        Goal(
            "late p99 beside them, over the loop alone",
            found["late_p99_us"]["beside"] / found["late_p99_us"]["alone"],
            BESIDE,
            "times",
        ),
        Goal("MIP, parsed natively", found["native_mb_s"], PARSER, "MB/s", True),
        Goal(
            "the same, over the parser in Python",
            found["native_mb_s"] / found["python_mb_s"],
            OVER_PYTHON,
            "times",
            True,
        ),
    ]


def of_views(looked_at, alone, dropped):
    """looked_at, alone : Kept; dropped : records"""
    return [
        Goal("all viewers on, lateness p99", looked_at.late(0.99) / alone.late(0.99), VIEWS, "times"),
        Goal("all viewers on, records dropped", dropped, 0, "records"),
    ]
