"""Conversion of rows and events to Rerun: one vector per subsystem and unit, limits, limbs, sensors and texts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from runtime.record.recorder.rerun.blueprint import EVENTS, SPACE
from runtime.record.recorder.rerun.scene import JOINTS, SEGMENTS, Limb, Scene, Sensor
from runtime.record.storage.changes import event_text

POSE_RATE = 50.0  # Hz, of the limbs
HIP_HEIGHT, HIP_WIDTH = 0.95, 0.25  # m
LENGTHS = {"thigh": 0.42, "shank": 0.43, "foot": 0.18}  # m, of an average adult
FLEXION_SIGN = {"hip": -1.0, "knee": 1.0, "ankle": -1.0}  # about the y axis; x is forward, z up
AXIS_LENGTH, HEEL_LENGTH = 0.15, 0.05  # m
SENSOR_OFFSET, SENSOR_ROW_X = 0.12, -0.35  # m, beside the leg; of sensors without a leg
# joint torque: zero, negative limit, positive limit
GREY, LOW, HIGH = np.array([150, 150, 150]), np.array([0, 114, 178]), np.array([213, 94, 0])
LIMIT_COLOUR = (150, 150, 150)
LEVELS = {"fault": "ERROR", "end": "INFO", "warning": "WARN", "mark": "INFO", "set": "INFO"}


class Stream:
    """Rerun's stream of a scene.

    recording : rerun.RecordingStream
    scene : Scene
    rate : Hz
    """

    def __init__(self, recording, scene, rate):
        self.recording, self.scene, self.rate = recording, scene, rate
        self.every = max(1, round(rate / POSE_RATE))
        self.faults = {}  # place: code
        self.begun = False
        self.statics()

    def log(self, path: list[str], what: Any, **how: Any) -> None:
        """Log an archetype of Rerun under an entity path. how : options of RecordingStream.log"""
        self.recording.log(path, what, **how)

    def statics(self) -> None:
        """Log names and colours of lines, and everything else that does not change."""
        for plot in self.scene.plots:
            self.log(
                list(plot.entity),
                rr.SeriesLines(names=plot.labels, visible_series=plot.shown, colors=plot.colours),
                static=True,
            )
            if plot.limits:
                names = [label for label, _ in plot.limits]
                self.log(
                    [*plot.entity, "limits"],
                    rr.SeriesLines(names=names, colors=[LIMIT_COLOUR] * len(names), widths=[1.0] * len(names)),
                    static=True,
                )
        if self.scene.limbs or self.scene.sensors:
            self.log(list(SPACE), rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        for limb in self.scene.limbs:
            self.log(hip_of(limb), rr.Transform3D(translation=[0.0, side(limb), HIP_HEIGHT]), static=True)
            for segment in SEGMENTS:
                strip = (
                    [[-HEEL_LENGTH, 0, 0], [LENGTHS["foot"], 0, 0]]
                    if segment == "foot"
                    else [[0, 0, 0], [0, 0, -LENGTHS[segment]]]
                )
                self.log(
                    [*entity(limb, segment), "bone"],
                    rr.LineStrips3D([strip], radii=0.025, colors=[200, 200, 205]),
                    static=True,
                )
        for sensor in self.scene.sensors:
            axes = [[AXIS_LENGTH, 0, 0], [0, AXIS_LENGTH, 0], [0, 0, AXIS_LENGTH]]
            colours = [[220, 60, 60], [60, 180, 75], [60, 100, 220]]
            self.log(axes_of(sensor), rr.Arrows3D(vectors=axes, colors=colours, radii=0.006), static=True)

    def rows(self, ticks: np.ndarray, times: np.ndarray, values: np.ndarray) -> None:
        """Send rows. ticks : (n,) int; times : (n,) s; values : (n, signals)"""
        if not len(ticks):
            return
        times, seconds = nanoseconds(times), times
        index = [rr.TimeColumn("time", duration=times), rr.TimeColumn("tick", sequence=ticks)]
        for plot in self.scene.plots:
            size = len(plot.columns)
            columns = rr.Scalars.columns(scalars=np.ascontiguousarray(values[:, plot.columns]).ravel()).partition(
                [size] * len(ticks)
            )
            self.send(plot.entity, index, columns)
            if plot.limits:
                ends = [0, len(ticks) - 1] if not self.begun and len(ticks) > 1 else [len(ticks) - 1]
                lines = np.tile([value for _, value in plot.limits], len(ends))
                when = [rr.TimeColumn("time", duration=times[ends]), rr.TimeColumn("tick", sequence=ticks[ends])]
                self.send(
                    [*plot.entity, "limits"],
                    when,
                    rr.Scalars.columns(scalars=lines).partition([len(plot.limits)] * len(ends)),
                )
        chosen = np.flatnonzero(ticks % self.every == 0)
        if len(chosen):
            when = [rr.TimeColumn("time", duration=times[chosen]), rr.TimeColumn("tick", sequence=ticks[chosen])]
            self.pose(when, values[chosen])
        self.log_faults(ticks, seconds, values)
        self.begun = True

    def send(self, path: Sequence[str], index: list[Any], columns: Any) -> None:
        """Send columns of an entity. index : time columns"""
        rr.send_columns(rr.new_entity_path(list(path)), index, columns, recording=self.recording)

    def pose(self, index: list[Any], values: np.ndarray) -> None:
        """Send the poses of limbs and sensors. index : time columns; values : (n, signals)"""
        for limb in self.scene.limbs:
            for joint, segment, above in zip(JOINTS, SEGMENTS, ("", *SEGMENTS)):
                known = limb.joints.get(joint)
                angle = np.nan_to_num(values[:, known.position]) if known is not None else np.zeros(len(values))
                at = np.tile([0.0, 0.0, -LENGTHS[above] if above else 0.0], (len(values), 1))
                half = 0.5 * FLEXION_SIGN[joint] * angle
                turn = np.column_stack((np.zeros_like(half), np.sin(half), np.zeros_like(half), np.cos(half)))
                self.send(entity(limb, segment), index, rr.Transform3D.columns(translation=at, quaternion=turn))
                if known is not None and known.torque is not None:
                    colours = colour(values[:, known.torque] / known.limit)
                    where = np.zeros((len(values), 3))
                    self.send(
                        [*entity(limb, segment), joint],
                        index,
                        rr.Points3D.columns(positions=where, colors=colours, radii=np.full(len(values), 0.045)),
                    )
        for sensor in self.scene.sensors:
            w, x, y, z = values[:, sensor.columns].T
            at = place_of(sensor, self.scene, values)
            self.send(
                axes_of(sensor), index, rr.Transform3D.columns(translation=at, quaternion=np.column_stack((x, y, z, w)))
            )

    def log_faults(self, ticks: np.ndarray, times: np.ndarray, values: np.ndarray) -> None:
        """Log each change of a device's fault code."""
        for place in self.scene.faults:
            codes = values[:, place]
            before = np.concatenate(([self.faults.get(place, 0.0)], codes[:-1]))
            for row in np.flatnonzero((codes != before) & ~np.isnan(codes)):
                text = f"{self.scene.signals[place]['path']}: {codes[row]:g}" + ("" if codes[row] else ", no fault")
                self.text(int(ticks[row]), float(times[row]), text, "ERROR" if codes[row] else "INFO")
            self.faults[place] = codes[-1]

    def event(self, event: dict[str, Any]) -> None:
        """Log an event of the recording. event : dict"""
        kind = str(event.get("event"))
        text = event_text(event)
        if text:
            tick = max(0, event.get("tick") or 0)
            level = "ERROR" if kind == "end" and event.get("status") != "ok" else LEVELS.get(kind, "INFO")
            self.text(tick, tick / self.rate, text, level)

    def text(self, tick: int, time: float, text: str, level: str) -> None:
        """Log a line of text. time : s; level : Rerun's level, such as ERROR"""
        self.recording.set_time("time", duration=nanoseconds(time))
        self.recording.set_time("tick", sequence=int(tick))
        self.log(list(EVENTS), rr.TextLog(text, level=level))


def nanoseconds(times: Any) -> Any:
    """Round s to ns. Rerun itself rounds down, which can order equal times differently."""
    return np.round(np.asarray(times) * 1e9).astype("timedelta64[ns]")


def colour(share: np.ndarray) -> np.ndarray:
    """Return colours (n, 3) of joint torques. share : (n,) torque over limit"""
    share = np.clip(np.nan_to_num(share), -1.0, 1.0)[:, None]
    return (GREY + np.abs(share) * (np.where(share < 0.0, LOW, HIGH) - GREY)).astype(np.uint8)


def hip_of(limb: Limb) -> list[str]:
    """Return the entity path of a hip."""
    return [*SPACE, limb.side]


def entity(limb: Limb, segment: str) -> list[str]:
    """Return the entity path of a segment, below that of its parent."""
    return [*hip_of(limb), *SEGMENTS[: SEGMENTS.index(segment) + 1]]


def axes_of(sensor: Sensor) -> list[str]:
    """Return the entity path of the axes of a sensor."""
    return [*SPACE, "sensors", sensor.path]


def side(limb: Limb) -> float:
    """Return the lateral position of a limb in m, positive to the left."""
    return -HIP_WIDTH / 2 if "right" in limb.side else HIP_WIDTH / 2 + max(0, limb.place - 1) * HIP_WIDTH


def place_of(sensor: Sensor, scene: Scene, values: np.ndarray) -> np.ndarray:
    """Return the positions (n, 3) of a sensor in m: beside its segment, or in a row behind if it has none."""
    limb = scene.limb_of(sensor)
    if limb is None:
        row = [other for other in scene.sensors if scene.limb_of(other) is None]
        return np.tile(
            [SENSOR_ROW_X, HIP_WIDTH * (row.index(sensor) - 0.5 * (len(row) - 1)), HIP_HEIGHT], (len(values), 1)
        )
    at = np.tile([0.0, side(limb) + np.sign(side(limb)) * SENSOR_OFFSET, HIP_HEIGHT], (len(values), 1))
    angle = np.zeros(len(values))
    for joint, segment in zip(JOINTS, SEGMENTS):
        if joint in limb.joints:
            angle = angle + FLEXION_SIGN[joint] * np.nan_to_num(values[:, limb.joints[joint].position])
        down = 0.0 if segment == "foot" else -LENGTHS[segment]
        ahead = LENGTHS[segment] if segment == "foot" else 0.0
        bone = np.column_stack(
            (
                down * np.sin(angle) + ahead * np.cos(angle),
                np.zeros_like(angle),
                down * np.cos(angle) - ahead * np.sin(angle),
            )
        )
        if segment == sensor.segment:
            return at + 0.5 * bone
        at = at + bone
    raise AssertionError(f"no segment {sensor.segment!r}")
