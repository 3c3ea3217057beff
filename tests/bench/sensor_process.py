"""Process of emulated inertial sensors: `python -m tests.bench.sensor_process FOLDER RATE SERIAL...`.

Each is on a pseudo-terminal.
"""

import sys
from pathlib import Path

from blocks.families import benchmark
from graph import Diagram, compile
from runtime.robot.emulation.lines import EmulatedLines
from runtime.robot.emulation.serving import Service


def main(folder: str, rate: str, *serials: str) -> None:
    """Emulate sensors until killed, and print a line when they are ready.

    folder : receives a link to the terminal of each, tty and the serial number
    rate : Hz of the plant
    serials : serial numbers of the sensors
    """
    with Diagram("sensors", rate=float(rate)) as plant:
        for serial in serials:
            benchmark("stream").emulator(bus=serial, serial=serial, streaming_at_start=False, name=f"imu_{serial}")
    schedule = compile(plant)
    lines = EmulatedLines(schedule.buses, Path(folder))
    service = Service(schedule, [lines.end(name) for name in schedule.buses])
    print("ready", flush=True)
    service.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
