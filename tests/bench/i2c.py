"""Cost of the thread of an I2C bus: three IMUs behind a multiplexer, on chips in memory, without a driver."""

import time
from dataclasses import dataclass
from pathlib import Path

from blocks.families import benchmark
from cext.lines.i2c import I2cBus
from cext.lines.i2c_memory import MemoryI2c
from graph import Diagram
from runtime.robot.rig.i2c import exchange

SENSORS, RATE = 3, 200.0  # how many; Hz, of each, its magnetometer at 100
THREAD = "tickwork-i2c"


@dataclass(frozen=True)
class Cost:
    """Cost of the thread of an I2C bus.

    processor : share of one
    exchanges : exchanges per second, including switches of the multiplexer
    each : s of one exchange
    answers : answers per second
    """

    processor: float
    exchanges: float
    each: float
    answers: float


def measure(seconds: float) -> Cost:
    """Run the thread with SENSORS emulated IMUs. Returns its Cost."""
    wires = MemoryI2c((0x70,))
    bus = I2cBus(wires)
    with Diagram("bench", rate=RATE):
        sensors = [
            benchmark("i2c").block(name=f"imu{number}", bus="imus", mux=0x70, channel=number, rate=RATE)
            for number in range(SENSORS)
        ]
    for sensor in sensors:
        wires.add(sensor.mag_address, sensor.place)
        wires.write(wires.add(sensor.address, sensor.place), *sensor.check())
        rounds = tuple(
            (one.period, one.settle, tuple(exchange(transfer, sensor.address) for transfer in one.transfers))
            for one in sensor.rounds()
        )
        bus.add(sensor.place, sensor.address, (), sensor.check(), rounds)
    bus.start(0)
    try:
        time.sleep(0.1)
        before, exchanges, answers, began = processor_time(), wires.exchanges, _answered(bus), time.perf_counter()
        time.sleep(seconds)
        took = time.perf_counter() - began
        spent, made, came = processor_time() - before, wires.exchanges - exchanges, _answered(bus) - answers
    finally:
        bus.stop()
    return Cost(spent / took, made / took, spent / made, came / took)


def _answered(bus: I2cBus) -> int:
    return sum(counts["answers"] for counts in bus.counts["devices"])


def processor_time() -> float:
    """Return the processor time of the thread, in s."""
    tasks = [task for task in Path("/proc/self/task").iterdir() if (task / "comm").read_text().strip() == THREAD]
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) * 1e-9
