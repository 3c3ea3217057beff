"""Page docs/hardware/compatibility.md: every actuator model, from the tables of the code.

python -m tests.docs.compatibility
"""

from blocks.actuators.ranges import RANGES
from blocks.actuators.sources import WIRES
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
* **Heat sink**: plate of aluminium on which the rated torque holds while the drive turns, mm. On a smaller one, and
  while the joint stands still, the drive gives less for long. CubeMars states none.
* A dash is a value that is not published.

No CubeMars board reports its settings over CAN, so Tickwork never counts on a time-out of one.

The class of a number is *manual*, *firmware* (of the vendor, disassembled), *two sources* that agree and do not copy
each other, *one source* (which nothing confirms) or *assumed*. `check` warns if a limit rests on an assumed number
([TW035](../reference/errors.md#tw035-limit-on-an-assumed-number-warning)). Nothing here was measured: [verified
drives](verified.md) lists what was.

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
([CubeMars product manual][CubeMars product manual]). The board of AK40-10, AK45-10 and AK45-36: its installation
manual, as public notes quote it. No source states the ranges of AKA10-9 and AKA60-6 in force control: use them in servo
mode, or pass the ranges that were measured on the unit.
""",
}
TAIL = """\
[CubeMars driver manual]: https://www.cubemars.com/data/cms/202605/ak-series-driver-manual-v1-0-18-for-ak-2-0-robotic-actuator.pdf
[CubeMars product manual]: https://www.cubemars.com/data/cms/202602/ak-series-prodcut-manual-v3-2-0-for-ak-3-0-robotic-actuator.pdf
[RobStride manuals]: https://github.com/RobStride/Product_Information
"""
COLUMNS = "| model | gear | rated | peak | current | speed | supply |{}\n|---|--:|--:|--:|--:|--:|--:|{}\n"
NUMBERS = {  # words of the columns of a model
    **{f"wire_{name}": f"range of {name}" for name in RANGES},
    "torque_constant": "torque constant",
    "rated_current": "rated current",
    "peak_current": "peak current",
    "pole_pairs": "pole pairs",
    "no_load": "speed without load",
    "too_hot": "highest temperature",
    "wake_shift": "step after power-up",
}
MODES = "| mode | block | bounded torque | stops without commands |\n|---|---|---|---|\n"
NOTES = {
    "RobStride and CyberGear": "| private protocol | `RobStride` | in operation and current mode; otherwise by the "
    "drive's own limit, not verified | after `can_timeout`, 0.1 s; a CyberGear does not |\n"
    "| MIT protocol | `RobStrideMIT` | yes | after `can_timeout`, with a "
    "[minimum firmware](../reference/actuators.md#robstride) |\n",
    "CubeMars, boards V1 and V2": "| MIT mode | `CubeMars` | yes | no, unless "
    "[`set_can_time_out`](drives.md#what-a-drive-does-without-commands) was set and declared |\n"
    "| servo mode | `CubeMarsServo` | for current commands only | after 1 s in the parameter files of CubeMars |\n",
    "CubeMars, boards V3.0": "| force control | `CubeMarsV3` | yes | after 1 s in the parameter files of "
    "CubeMars |\n| servo mode | `CubeMarsServo` | for current commands only | the same |\n",
}


def page():
    """Return the text of the page."""
    tables = [table for family in families() for table in family.tables if table.title in NOTES]
    sections = [
        f"## {table.title}\n\n{MODES}{NOTES[table.title]}\n{columns(table)}"
        + "".join(map(row, table.models.values()))
        + SUPPLIES[table.title]
        + sources(table)
        for table in tables
    ]
    return "\n".join([HEAD, *sections, TAIL])


def columns(table):
    """Return the head of a table: with heat sinks if its vendor states them."""
    return COLUMNS.format(*(" heat sink |", "---|") if has_heat_sinks(table.models.values()) else ("", ""))


def has_heat_sinks(models):
    return any(getattr(model, "heat_sink", "") for model in models)


def sources(table):
    """Return the table of the sources of a table's numbers."""
    models = list(table.models.values())
    rows = {}
    for name, source in type(models[0]).SOURCES.items():
        rows.setdefault((source, "the others"), []).append(name)
    for model in models:
        for name, source in model.sources:
            rows.setdefault((source, model.name), []).append(name)
    merged = {}
    for (source, model), names in rows.items():
        merged.setdefault((source, tuple(names)), []).append(model)
    lines = [
        f"| {in_words(names)} | {', '.join(found)} | {source.kind} | {source.text} |\n"
        for (source, names), found in merged.items()
    ]
    return "\n| number | models | class | source |\n|---|---|---|---|\n" + "".join(lines)


def in_words(columns):
    """Return the names of columns as text."""
    ranges = "all ranges" if set(WIRES) <= set(columns) else ""
    names = [NUMBERS.get(name, name) for name in columns if not ranges or name not in WIRES]
    return ", ".join([ranges] * bool(ranges) + names)


def row(model):
    """Return the line of one model."""
    currents = [model.rated_current, model.peak_current]
    current = " / ".join(f"{each:.3g}" for each in currents) if all(currents) else "—"
    supply = "{:g} to {:g}".format(*model.supply) if getattr(model, "supply", ()) else "—"
    supply += " (assumed)" if getattr(model, "supply_note", "") else ""
    cells = [f"{model.gear:g}:1", known(model.rated), known(model.peak), current, f"{model.wire_velocity:g}", supply]
    if hasattr(model, "heat_sink"):
        cells.append(model.heat_sink or "—")
    return f"| {model.name} | {' | '.join(cells)} |\n"


def known(value):
    """Return a number as text; a dash if it is None."""
    return "—" if value is None else f"{value:g}"


if __name__ == "__main__":
    PAGE.write_text(page())
