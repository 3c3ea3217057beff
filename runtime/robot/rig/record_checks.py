"""Records of commissioning that arming with a subject file asks for, compared with the units that respond."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from graph.caveats import Caveat
from runtime.robot.rig.acceptance import RECORD
from runtime.robot.rig.identity import identities
from runtime.robot.rig.records import every_record, file_of, recorded_devices

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from graph import Diagram, Schedule
    from runtime.robot.rig.file import RigFile
    from runtime.robot.rig.records import Record


@dataclass(frozen=True)
class Compared:
    """Records of the units that respond, {path of a block: Record}, and lines on what was compared.

    serials : {path: serial number of the only unit that responds}
    """

    records: dict[str, Record]
    lines: list[str]
    serials: dict[str, str]

    def require(self, diagram: Diagram, schedule: Schedule) -> None:
        """Let every arming of a run accept these units alone, where they report their numbers while they are armed."""
        for path, serial in self.serials.items():
            for name, values in diagram[path].unit_memory(serial).items():
                first, length = schedule.items[path][name]
                schedule.arena[first : first + length] = values


def compare_records(
    rig: RigFile, diagram: Diagram, who: str, accepted: Sequence[str]
) -> tuple[list[Caveat], Compared | None]:
    """Return (Caveats of devices without a record that applies, Compared).

    The units are asked for their serial numbers and firmware, unless a caveat that is not accepted prevents the run
    anyway. Raises RigError if a bus cannot be opened, BadInput for a record that cannot be read.

    who : name of the subject file; accepted : names passed to --accept
    """
    records, devices = every_record(rig.path), recorded_devices(diagram)
    of_joint = {record.device: record for record in records}
    caveats = caveats_of(devices, of_joint, rig, who)
    if any(caveat.name not in accepted for caveat in caveats):
        return caveats, None
    units, lines = identities(rig, devices), []
    of_serial = {record.serial: record for record in records}
    live: dict[str, list[str]] = {}
    serials: dict[str, str] = {}
    for path, found in ((block.path, units.get(block.path)) for block in devices):
        record, about = of_joint.get(path), ""
        if found is None:
            about = "serial number and firmware not compared: its protocol reports neither"
        elif len(found) != 1:
            who_responds = f"units {' and '.join(found)} respond" if found else "no unit responds"
            live[path] = [f"cannot be compared: {who_responds}"]
        else:
            [(serial, firmware)] = found.items()
            serials[path] = serial
            about = "serial number and firmware compared" if firmware else "serial number compared, no firmware"
            if (record := of_serial.get(serial, record)) is not None:
                of_joint[path], live[path] = record, record.differences(serial, firmware)
        if record is not None:
            about = f"accepted although it {'; '.join(live[path])}" if live.get(path) else about
            lines.append(f"{path}: record {record.serial} of {record.signed['date']}; {about}")
    return caveats_of(devices, of_joint, rig, who, live), Compared(of_joint, lines, serials)


def caveats_of(
    devices: Sequence[Any], records: Mapping[str, Record], rig: RigFile, who: str, live: Mapping[str, list[str]] = {}
) -> list[Caveat]:
    """Return a Caveat for each device whose record does not apply.

    records : {path: Record}; live : {path: differences of the unit that responds}; others as in `compare_records`
    """
    caveats: list[Caveat] = []
    for block in devices:
        if (record := records.get(block.path)) is None:
            words = "which is missing"
        elif reasons := [*record.mismatches(block), *live.get(block.path, ()), *record.faults(block)]:
            words = f"and {file_of(rig.path, record)} {'; '.join(reasons)}"
        else:
            continue
        words = f"{who} asks for its record of commissioning, {words}. Run the command `commission`"
        caveats.append(Caveat(block.path, RECORD, words, False))
    return caveats
