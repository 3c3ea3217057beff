"""Page docs/hardware/verified.md: drives that were measured, from the records in verified.toml beside it.

python -m tests.docs.verified                     # writes the page
python -m tests.docs.verified RECORD.toml ...     # adds records of `commission` that were sent, and writes it
"""

import sys
from pathlib import Path

try:
    import tomllib
except ModuleNotFoundError:  # before Python 3.11
    import tomli as tomllib

from blocks.families import find_model
from runtime.robot.rig.records import AGREES, DIFFERS, Record, of_text, toml
from tests.checkout import ROOT

PAGE = ROOT / "docs" / "hardware" / "verified.md"
RECORDS = PAGE.with_suffix(".toml")
FIELDS = ("model", "firmware", "board", "computer", "adapter", "who", "when", "measured", "differed")
HEAD = """# Verified drives

Measurements on real drives, and what differed from the tables and this documentation. A record is about one unit with
one firmware: another unit of the same model may differ.

"""
NONE = """**There are no records yet.** No drive, of any model, has been tested with Tickwork.

"""
TAIL = """## Send a record

Fill in the form *Measured drive* of the issue tracker, whether everything agreed or something differed. Useful
measurements, in the order of [first steps with any drive](drives.md#first-steps-with-any-drive):

| measurement | what it decides |
|---|---|
| one turn of the output by hand | range of position, gear |
| the same at a known speed | range of velocity, pole pairs |
| a torque against a load cell at a known lever arm | range of torque, torque constant, kind of ampere |
| torque of a damping at a known speed, against the load cell | range of damping: no drive reports it |
| the torque after the CAN plug is pulled, for 10 s | the drive's own time-out |
| the reading after a turn by hand without power | which turns the encoder counts |
| the error byte while the housing is warm | the meaning of error codes |

[`commission`](../how_to/commission.md) guides through them and writes a record of each unit: attach it to the form.
`python -m tests.docs.verified RECORD.toml` adds it to `docs/hardware/verified.toml`, and writes this page.
"""


def records():
    """Return the records. Raises ValueError for a record without a field, or of an unknown model."""
    found = tomllib.loads(RECORDS.read_text()).get("drive", [])
    for record in found:
        if set(record) != set(FIELDS) or not all(isinstance(value, str) and value for value in record.values()):
            raise ValueError(f"{RECORDS.name}: a record needs the fields {', '.join(FIELDS)}, got {record}")
        find_model(record["model"])
    return found


def page(found=None):
    """Return the text of the page. found : records, by default those of the file"""
    found = records() if found is None else found
    head, line = "| " + " | ".join(FIELDS) + " |\n", "|---" * len(FIELDS) + "|\n"
    rows = "".join(f"| {' | '.join(record[field] for field in FIELDS)} |\n" for record in found)
    return HEAD + (head + line + rows + "\n" if found else NONE) + TAIL


def row_of(record: Record):
    """Return the fields of a record of `commission`."""
    steps = [(name, step) for name, step in record.steps.items() if step.verdict in (AGREES, DIFFERS)]
    measured = [f"{name}: {'; '.join(step.says)}" for name, step in steps]
    return {
        "model": record.model,
        "firmware": record.firmware or "not read",
        "board": f"not recorded, block {record.block}",
        "computer": record.about.get("computer", "not recorded"),
        "adapter": record.about.get("adapter", "not recorded"),
        "who": record.signed["name"],
        "when": record.signed["date"],
        "measured": ". ".join(measured).replace("|", "/") or "nothing",
        "differed": ". ".join(f"{name}: {text}" for name, text in record.findings).replace("|", "/") or "nothing",
    }


def add(paths):
    """Add the records of files to those of the page."""
    rows = [row_of(of_text(Path(path).read_text(), Path(path))) for path in paths]
    lines = [line for row in rows for line in ("", "[[drive]]", *(f"{name} = {toml(row[name])}" for name in FIELDS))]
    RECORDS.write_text("\n".join([RECORDS.read_text().rstrip("\n"), *lines, ""]))


if __name__ == "__main__":
    add(sys.argv[1:])
    PAGE.write_text(page())
