"""A process with MicroStrain sensors on pseudo-terminals, for tests:
`python -m tests.runtime.robot.rig.sensors FOLDER RATE SERIAL[=MODEL]...`.

Each has a link in the folder, named after its serial number; a line on standard output reports that they are ready. It
ends when it is killed.
"""

import sys

from blocks.imus import EmulatedMicroStrain
from graph import Diagram, compile
from runtime.robot.emulation.lines import EmulatedLines
from runtime.robot.emulation.priority import take_priority
from runtime.robot.emulation.serving import Service


def main(folder, rate, *sensors):
    with Diagram("sensors", rate=float(rate)) as plant:
        for sensor in sensors:
            serial, _, model = sensor.partition("=")
            EmulatedMicroStrain(
                bus=serial, serial=serial, model=model or "3DM-GX5-25", streaming_at_start=False, name=f"imu_{serial}"
            )
    schedule = compile(plant)
    lines = EmulatedLines(schedule.buses, folder)
    service = Service(schedule, [lines.end(name) for name in schedule.buses])
    take_priority()  # already now: they answer at once
    print("ready", flush=True)
    service.run()


if __name__ == "__main__":
    main(*sys.argv[1:])
