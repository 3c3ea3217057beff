"""Streams of an XDF file on the time axis of a trial, whose Lsl block sent one of them."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from xml.etree.ElementTree import ParseError

import numpy as np

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need

if TYPE_CHECKING:
    from runtime.record.analysis.trial_data import TrialData

SIGNALS = "Signals"  # content type of the stream of an Lsl block
SAME = 1e-6  # s, by which two times of a tick may differ


@dataclass(frozen=True)
class Stream:
    """Stream of an XDF file.

    time : (samples,) s on the axis of the trial
    values : (samples, channels) array, or a list of lists of texts
    labels, units : of each channel, "" if unknown
    kind : content type, such as EMG or Markers
    """

    time: np.ndarray
    values: Any
    labels: tuple[str, ...]
    units: tuple[str, ...]
    kind: str


def streams(trial: TrialData, path: str | os.PathLike[str]) -> dict[str, Stream]:
    """Return {name: Stream} of an XDF file, as Trial.xdf does."""
    xdf = need("pyxdf", "an XDF file")
    if not os.path.exists(path):
        raise BadInput(f"no such file: {path}")
    try:
        raw, synchronized = (
            xdf.load_xdf(os.fspath(path), synchronize_clocks=whether, dejitter_timestamps=False)[0]
            for whether in (False, True)
        )
    except (OSError, ValueError, ParseError) as error:
        raise BadInput(f"{path} is not an XDF file: {error}") from None
    signals = [place for place, stream in enumerate(raw) if is_of_a_run(stream)]
    own = [place for place in signals if recording_of(raw[place]) == trial.path.stem]
    own += [place for place in signals if has_ticks_of(raw[place], trial)]
    if not own:
        listed = ", ".join(names(raw)) or "no stream"
        raise BadInput(f"{path} has no signals of the recording {trial.path.stem}: its streams are {listed}")
    # our own stamps on the clock of the file, and on that of the run: their line maps every other stream
    stamps, here = synchronized[own[0]]["time_stamps"], np.asarray(raw[own[0]]["time_stamps"]) - start(trial)
    origin = stamps[0]
    slope, offset = np.polyfit(np.asarray(stamps) - origin, here, 1)
    return {
        name: Stream(
            offset + slope * (np.asarray(stream["time_stamps"]) - origin),
            stream["time_series"],
            tuple(text(channel, "label") for channel in channels_of(stream)),
            tuple(text(channel, "unit") for channel in channels_of(stream)),
            text(stream["info"], "type"),
        )
        for name, stream in zip(names(synchronized), synchronized)
    }


def names(found: Sequence[dict[str, Any]]) -> list[str]:
    """Return the names of streams. Those of one name have their source_id in brackets, and their number if need be."""
    infos = [stream["info"] for stream in found]
    unique = [text(info, "name") for info in infos]
    for ends in ([f" ({text(info, 'source_id')})" for info in infos], [f" {info['stream_id']}" for info in infos]):
        unique = [name + end if unique.count(name) > 1 else name for name, end in zip(unique, ends)]
    return unique


def start(trial: TrialData) -> float:
    """Return the time of tick 0 in s of CLOCK_MONOTONIC; 0 in virtual time."""
    begin = next((event["monotonic"] for event in trial.events if event["event"] == "begin"), 0)
    return (trial.end or {}).get("monotonic", begin) * 1e-9


def is_of_a_run(stream: dict[str, Any]) -> bool:
    """Return whether a stream has signals of an Lsl block."""
    return bool(recording_of(stream)) and text(stream["info"], "type") == SIGNALS and len(stream["time_stamps"]) > 1


def recording_of(stream: dict[str, Any]) -> str:
    """Return the name of the recording with the signals of a stream, "" for another stream."""
    described = (stream["info"].get("desc") or [None])[0] or {}
    return text((described.get("acquisition") or [None])[0], "recording")


def has_ticks_of(stream: dict[str, Any], trial: TrialData) -> bool:
    """Return whether a stream has ticks of a trial, although it names another recording.

    LabRecorder continues a stream in the next run of the robot, and a recording may have been renamed.
    """
    stamps = np.asarray(stream["time_stamps"]) - start(trial)
    stamps = stamps[(stamps >= trial.time[0] - SAME) & (stamps <= trial.time[-1] + SAME)]
    at = np.searchsorted(trial.time, stamps - SAME).clip(max=len(trial.time) - 1)
    return len(stamps) > 1 and bool(np.median(np.abs(trial.time[at] - stamps)) < SAME)


def channels_of(stream: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the descriptions of the channels, as many as there are."""
    described = (stream["info"].get("desc") or [None])[0] or {}
    listed = ((described.get("channels") or [None])[0] or {}).get("channel", [])
    return [*listed, *[{}] * (int(stream["info"]["channel_count"][0]) - len(listed))]


def text(content: dict[str, Any] | None, key: str) -> str:
    """Return a text of a description, "" without one."""
    return ((content or {}).get(key) or [""])[0] or ""
