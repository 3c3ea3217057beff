"""Streams of an XDF file on the time axis of a trial, whose Lsl block sent one of them."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.host.optional_dependencies import need

if TYPE_CHECKING:
    from runtime.record.analysis.trial_data import TrialData

SIGNALS = "Signals"  # content type of the stream of an Lsl block


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
    except (OSError, ValueError) as error:
        raise BadInput(f"{path} is not an XDF file: {error}") from None
    place = next((place for place, stream in enumerate(raw) if is_of(stream, trial)), None)
    if place is None:
        names = ", ".join(stream["info"]["name"][0] for stream in raw) or "no stream"
        raise BadInput(f"{path} has no signals of the recording {trial.path.stem}: its streams are {names}")
    # our own stamps on the clock of the file, and on that of the run: their line maps every other stream
    origin, here = synchronized[place]["time_stamps"][0], np.asarray(raw[place]["time_stamps"]) - start(trial)
    slope, offset = np.polyfit(np.asarray(synchronized[place]["time_stamps"]) - origin, here, 1)
    return {
        stream["info"]["name"][0]: Stream(
            offset + slope * (np.asarray(stream["time_stamps"]) - origin),
            stream["time_series"],
            tuple(text(channel, "label") for channel in channels_of(stream)),
            tuple(text(channel, "unit") for channel in channels_of(stream)),
            stream["info"]["type"][0],
        )
        for stream in synchronized
    }


def start(trial: TrialData) -> float:
    """Return the time of tick 0 in s of CLOCK_MONOTONIC; 0 in virtual time."""
    begin = next((event["monotonic"] for event in trial.events if event["event"] == "begin"), 0)
    return (trial.end or {}).get("monotonic", begin) * 1e-9


def is_of(stream: dict[str, Any], trial: TrialData) -> bool:
    """Return whether a stream has the signals of a trial."""
    described = (stream["info"]["desc"] or [None])[0] or {}
    recording = text((described.get("acquisition") or [{}])[0], "recording")
    return recording == trial.path.stem and stream["info"]["type"][0] == SIGNALS and len(stream["time_stamps"]) > 1


def channels_of(stream: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the descriptions of the channels, as many as there are."""
    described = (stream["info"]["desc"] or [None])[0] or {}
    listed = ((described.get("channels") or [None])[0] or {}).get("channel", [])
    return [*listed, *[{}] * (int(stream["info"]["channel_count"][0]) - len(listed))]


def text(content: dict[str, Any] | None, key: str) -> str:
    """Return a text of a description, "" without one."""
    return ((content or {}).get(key) or [""])[0] or ""
