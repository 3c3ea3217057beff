"""XDF export, as LabRecorder writes it: a stream with the signals, and one with the events.

The streams are those of an Lsl block, with time stamps on the same clock: a run in real time counts on CLOCK_MONOTONIC,
one in virtual time from 0. The format is described at https://github.com/sccn/xdf/wiki/Specifications.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable
from typing import BinaryIO
from xml.sax.saxutils import escape

import numpy as np

from runtime.record.analysis.trial import Trial
from runtime.record.analysis.xdf import SIGNALS, start
from runtime.record.storage.changes import event_text

EXTENSIONS = {"xdf": "xdf"}
FILE_HEADER, STREAM_HEADER, SAMPLES, CLOCK_OFFSET, STREAM_FOOTER = 1, 2, 3, 4, 6  # tags of chunks
SIGNALS_ID, EVENTS_ID = 1, 2  # of the streams
GROUP = 1000  # samples of a chunk
EIGHT = b"\x08"  # a length of 8 bytes follows, or a time stamp
HEADER = '<?xml version="1.0"?><info>{}</info>'


def check(trial: Trial, kind: str) -> None:
    """Accept every recording. Arguments are not used"""


def write(trial: Trial, path: str, progress: Callable[[float], None]) -> None:
    """Write the file.

    path : path of the file, which is overwritten
    progress : called with the fraction that is done
    """
    rate, began, name = trial.about["rate"], start(trial), trial.about["name"]
    with open(path, "wb") as file:
        file.write(b"XDF:")
        put(file, FILE_HEADER, HEADER.format("<version>1.0</version>").encode())
        channels = [(signal, described["unit"]) for signal, described in trial.signals.items()]
        describe(file, SIGNALS_ID, name, SIGNALS, "double64", rate, channels, trial)
        describe(file, EVENTS_ID, f"{name} events", "Markers", "string", 0.0, [("event", "")], trial)
        done, first, last = 0, began, began
        sample = np.dtype([("length", "u1"), ("stamp", "<f8"), ("values", "<f8", (len(channels),))])
        for group in trial.row_groups(GROUP):
            chunk = np.zeros(len(group.tick), sample)
            chunk["length"], chunk["stamp"], chunk["values"] = 8, began + group.time, group.values
            samples(file, SIGNALS_ID, len(chunk), chunk.tobytes())
            first = first if done else float(chunk["stamp"][0])
            last, done = float(chunk["stamp"][-1]), done + len(chunk)
            progress(done / max(1, len(trial)))
        texts = [(began + max(0, event.get("tick") or 0) / rate, event_text(event)) for event in trial.events]
        texts = [(stamp, text.encode()) for stamp, text in texts if text]
        for stamp, text in texts:
            samples(file, EVENTS_ID, 1, EIGHT + struct.pack("<d", stamp) + EIGHT + struct.pack("<Q", len(text)) + text)
        for stream in (SIGNALS_ID, EVENTS_ID):  # the clock of both is that of the file
            for time in (began, last + 1.0):
                put(file, CLOCK_OFFSET, struct.pack("<Idd", stream, time, 0.0))
        end(file, SIGNALS_ID, first, last, done)
        end(file, EVENTS_ID, texts[0][0] if texts else began, texts[-1][0] if texts else began, len(texts))


def put(file: BinaryIO, tag: int, content: bytes) -> None:
    """Write a chunk."""
    file.write(EIGHT + struct.pack("<QH", len(content) + 2, tag) + content)


def samples(file: BinaryIO, stream: int, count: int, content: bytes) -> None:
    """Write a chunk of samples."""
    put(file, SAMPLES, struct.pack("<I", stream) + EIGHT + struct.pack("<Q", count) + content)


def describe(
    file: BinaryIO,
    stream: int,
    name: str,
    kind: str,
    form: str,
    rate: float,
    channels: Iterable[tuple[str, str]],
    trial: Trial,
) -> None:
    """Write the header of a stream. form : format of the channels; channels : (label, unit) of each"""
    listed = [
        f"<channel><label>{escape(label)}</label><unit>{escape(unit)}</unit><type>{kind}</type></channel>"
        for label, unit in channels
    ]
    text = (
        f"<name>{escape(name)}</name><type>{kind}</type><channel_count>{len(listed)}</channel_count>"
        f"<nominal_srate>{rate:.17g}</nominal_srate><channel_format>{form}</channel_format>"
        f"<source_id>tickwork {escape(name)}</source_id><desc><channels>{''.join(listed)}</channels><acquisition>"
        f"<manufacturer>Tickwork</manufacturer><model>{escape(trial.about['name'])}</model>"
        f"<recording>{escape(trial.path.stem)}</recording></acquisition></desc>"
    )
    put(file, STREAM_HEADER, struct.pack("<I", stream) + HEADER.format(text).encode())


def end(file: BinaryIO, stream: int, first: float, last: float, count: int) -> None:
    """Write the footer of a stream. first, last : s, time stamps"""
    text = f"<first_timestamp>{first:.9f}</first_timestamp><last_timestamp>{last:.9f}</last_timestamp>"
    text += f"<sample_count>{count}</sample_count>"
    put(file, STREAM_FOOTER, struct.pack("<I", stream) + HEADER.format(text).encode())
