"""candump export: every frame of every CAN bus, as the recorder's CAN log has it.

(1763683200.004512) legs 001#7FFF7FF0000007FF T

The format is that of `candump -L`, as python-can writes it. R: received; T: sent by the run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.analysis.trial import Trial
from runtime.record.storage.format import CLASSIC_BYTES, FD_FLAGS, ID_FLAGS, ID_MASK

EXTENSIONS = {"candump": "can.log"}
ERROR_FRAME = "20000080"  # identifier that python-can writes for every error frame: CAN_ERR_FLAG | CAN_ERR_BUSERROR


def check(trial: Trial, kind: str) -> None:
    """Raise BadInput for a recording without a CAN bus. kind : not used"""
    if not on_can(trial.about):
        raise BadInput(f"{trial.path} has no CAN bus")


def on_can(about: dict[str, Any]) -> dict[int, str]:
    """Return {index: name} of the buses that are CAN. A recording without their media has CAN only."""
    media = about.get("media") or ["can"] * len(about["buses"])
    return {index: bus for index, (bus, medium) in enumerate(zip(about["buses"], media)) if medium == "can"}


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    buses, began, done = on_can(trial.about), trial.began, 0
    names = {index: f"can{bus}" if bus.isdigit() else bus for index, bus in buses.items()}
    with open(path, "w", encoding="utf-8", newline="\n") as file:
        for rows, frames in trial.batches():
            frames = frames[np.isin(frames["bus"], list(buses))]
            times = ((began + frames["time"]) * 1e-9).tolist()
            fields = frames[["id", "length", "flags", "bus", "sent"]].tolist()
            file.writelines(
                line(time, names[bus], word, flags, sent, data.tobytes()[:length])
                for time, (word, length, flags, bus, sent), data in zip(times, fields, frames["data"])
            )
            done += len(rows)
            progress(done / max(1, len(trial)))


def line(time: float, bus: str, word: int, flags: int, sent: int, data: bytes) -> str:
    """Return the line of a frame.

    time : s
    bus : name of the interface
    word : identifier with the flag bits of SocketCAN
    flags : CAN FD flags
    sent : whether the run sent it
    """
    identifier, end = word & ID_MASK, " T\n" if sent else " R\n"
    if word & ID_FLAGS["error"]:
        head, end = ERROR_FRAME, "\n"
    elif word & ID_FLAGS["extended"]:
        head = f"{identifier:08X}"
    else:
        head = f"{identifier:03X}"
    if word & ID_FLAGS["remote"]:
        content = "R"
    elif flags & FD_FLAGS["fd"] or len(data) > CLASSIC_BYTES:
        content = f"#{flags & (FD_FLAGS['rate_switch'] | FD_FLAGS['error_state']):X}{data.hex().upper()}"
    else:
        content = data.hex().upper()
    return f"({time:f}) {bus} {head}#{content}{end}"
