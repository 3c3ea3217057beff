"""Page docs/hardware/compatibility.md: every actuator model, from the tables of the code.

python -m tests.docs.compatibility
"""

from blocks.families import families
from tests.checkout import ROOT

PAGE = ROOT / "docs" / "hardware" / "compatibility.md"
HEAD = """# Compatible actuators

The models that Tickwork supports, with their ratings. `python -m runtime blocks --actuators` also prints the ranges of
their protocols.

None of these drives has been tested. The bytes of every protocol are compared with the vendors' manuals and with other
implementations; the sources are in the [reference](../reference/actuators.md).

* **Rated, peak**: torque at the output, N·m. The limit of a command is the rated torque unless `limit` changes it.
* **Current**: amplitude in a phase of the motor, at the rated and at the peak torque, A.
* **Supply**: operating voltage of the drive, V. Its source is below each table.
* **Speed**: range of the wire protocol, rad/s. The speed that a motor reaches depends on its supply.
* **Bounded torque**: whether `check` proves that the torque stays within its limit.
* **Stops without commands**: whether the drive stops by itself if it receives no more commands.
* A dash is a value that is not published.

`python -m tests.docs.compatibility` writes this page from the tables of the code.
"""
SUPPLIES = {
    "RobStride and CyberGear": """
Supply: "operating voltage range" of each model's user manual of 2026-04-28, section 1
([RobStride manuals][RobStride manuals]), and of the CyberGear manual.
""",
    "CubeMars, boards V1 and V2": """
Supply: "allowable working voltage" of the boards in the driver manual V1.0.18, 18 to 52 V of V2.1 and 18 to 28 V of
V2.2 ([CubeMars driver manual][CubeMars driver manual]). The board follows from the rated voltage of the model's product
page: V2.1 for 48 V and 24/48 V, V2.2 for 24 V. *Assumed*: no source states the range of the smaller board of this
model, and that of the other board for 24 V is used.
""",
    "CubeMars, boards V3.0": """
Supply: "allowable working voltage range" of all three boards in the product manual V3.2.0, section 1.1
([CubeMars product manual][CubeMars product manual]).
""",
}
TAIL = """\
[CubeMars driver manual]: https://www.cubemars.com/data/cms/202605/ak-series-driver-manual-v1-0-18-for-ak-2-0-robotic-actuator.pdf
[CubeMars product manual]: https://www.cubemars.com/data/cms/202602/ak-series-prodcut-manual-v3-2-0-for-ak-3-0-robotic-actuator.pdf
[RobStride manuals]: https://github.com/RobStride/Product_Information
"""
COLUMNS = "| model | gear | rated | peak | current | speed | supply |\n|---|--:|--:|--:|--:|--:|--:|\n"
MODES = "| mode | block | bounded torque | stops without commands |\n|---|---|---|---|\n"
NOTES = {
    "RobStride and CyberGear": "| private protocol | `RobStride` | in operation and current mode; otherwise by the "
    "drive's own limit, not verified | after `can_timeout`, 0.1 s; a CyberGear does not |\n"
    "| MIT protocol | `RobStrideMIT` | yes | after `can_timeout`, with a "
    "[minimum firmware](../reference/actuators.md#robstride) |\n",
    "CubeMars, boards V1 and V2": "| MIT mode | `CubeMars` | yes | not documented for CAN |\n"
    "| servo mode | `CubeMarsServo` | for current commands only | not documented |\n",
    "CubeMars, boards V3.0": "| force control | `CubeMarsV3` | yes | not documented |\n"
    "| servo mode | `CubeMarsServo` | for current commands only | not documented |\n",
}


def page():
    """Return the text of the page."""
    tables = [table for family in families() for table in family.tables if table.title in NOTES]
    sections = [
        f"## {table.title}\n\n{MODES}{NOTES[table.title]}\n{COLUMNS}"
        + "".join(map(row, table.models.values()))
        + SUPPLIES[table.title]
        for table in tables
    ]
    return "\n".join([HEAD, *sections, TAIL])


def row(model):
    """Return the line of one model."""
    currents = [model.rated_current, model.peak_current]
    current = " / ".join(f"{each:.3g}" for each in currents) if all(currents) else "—"
    supply = "{:g} to {:g}".format(*model.supply) if getattr(model, "supply", ()) else "—"
    supply += " (assumed)" if getattr(model, "supply_note", "") else ""
    cells = [f"{model.gear:g}:1", known(model.rated), known(model.peak), current, f"{model.wire_velocity:g}", supply]
    return f"| {model.name} | {' | '.join(cells)} |\n"


def known(value):
    """Return a number as text; a dash if it is None."""
    return "—" if value is None else f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page())
