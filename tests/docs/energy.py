"""Page docs/hardware/energy.md: currents and energy of the robots of this repository, from their simulation.

python -m tests.docs.energy
"""

from graph import Actuator
from graph.assembly import assemble
from graph.compiler import examine
from runtime.robot.loading.file import load
from runtime.robot.loading.simulation import Simulation
from runtime.robot.rig.battery import Battery
from runtime.session.check.battery import budget, duration, loads
from tests.checkout import ROOT
from tests.diagrams.robots import ROBOTS, SUITS, path

PAGE = ROOT / "docs" / "hardware" / "energy.md"
BATTERY = Battery(voltage=24.0, capacity=4.0, full_voltage=24.0, load=15.0)
HEAD = f"""# Currents and energy of the robots

The robots of this repository with a battery of {BATTERY.voltage:g} V and {BATTERY.capacity:g} A·h, and a load of
{BATTERY.load:g} W for computer and sensors. The numbers come from the simulation with the average adult and from the
ratings of the drives; nothing on this page has been tested on a robot. `check` prints the same for your robot, with the
battery of its rig file ([Power](power.md#battery)).

* **Drive**: largest supply current of one drive, at the torque that the compiler has proved. Compare the fuse with it.
* **Peak**: largest current of the battery, with every drive at that torque and at full speed.
* **Motion, heat**: mean power of the drives over 20 s of simulated walking. Energy that flows back is not counted.
* **Lasts**: time of one charge in that use. **At least**: time with every drive at its rated torque and full speed.

`python -m tests.docs.energy` writes this page.

| robot | drives | drive | peak | motion | heat | lasts | at least |
|---|---|--:|--:|--:|--:|--:|--:|
"""


def page():
    """Return the text of the page. Takes 20 s."""
    return HEAD + "".join(row(robot) for robot in ROBOTS if robot not in SUITS)


def row(robot):
    """Return the line of one robot."""
    file, diagram = load(path(robot))
    analysis = examine(diagram)
    schedule = assemble(analysis)
    drives = loads(diagram, analysis)
    models = [block.model for block in diagram if isinstance(block, Actuator)]
    found = budget(BATTERY, drives, schedule, Simulation(file, diagram, schedule))
    used = found["simulated"]
    cells = [
        ", ".join(f"{models.count(model)} × {model}" for model in dict.fromkeys(models)),
        f"{max(drive['supply_current'] for drive in found['drives']):.1f} A",
        f"{found['peak']:.0f} A",
        f"{used['mechanical']:.1f} W",
        f"{used['heat']:.1f} W",
        duration(used["time"]),
        duration(found["least_time"]),
    ]
    return f"| [{robot}](../robots/{robot}.md) | {' | '.join(cells)} |\n"


if __name__ == "__main__":
    PAGE.write_text(page())
