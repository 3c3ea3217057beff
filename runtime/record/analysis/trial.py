"""Trial: a recording with every signal of every tick, the frames, the events and the metadata.

A truncated or damaged file is read up to the last complete row; `complete` is then False. It includes the parts that
standby recorders continued.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.errors import BadInput
from runtime.record.analysis import resample, strides, table
from runtime.record.analysis.trial_data import TrialData

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import numpy as np
    import pandas

    from runtime.record.analysis.clocks import Clock
    from runtime.record.analysis.pictures import Pictures
    from runtime.record.analysis.xdf import Stream


REMEDIES = {  # {attribute of other libraries' tables: remedy}
    **dict.fromkeys(("data", "dataframe", "df", "to_pandas"), "call trial.table() for a pandas.DataFrame"),
    **dict.fromkeys(("export", "save", "to_csv"), "convert its file with `python -m runtime convert FILE --to csv`"),
    **dict.fromkeys(("columns", "keys"), "trial.names lists its signals"),
    **dict.fromkeys(("error", "status", "success"), "read trial.fault, None after a normal end"),
    "duration": "read trial.time[-1]",
    "rate": "read trial.about['rate']",
    "get": "read a signal as in trial['knee.position']",
}


class Trial(TrialData):
    """Recording, with its signals over the gait cycle, at other rates, and as a table.

    trial = runtime.load("recordings/knee_exo_2026-11-21_10-00-00.mcap")
    trial["left/knee.position"]             # array over the ticks
    trial.unit("left/knee.position")        # "rad"
    trial.time                              # array over the ticks, s
    trial.time_of("left/knee.position")     # times of its samples in s, if it was recorded at a lower rate
    """

    if not TYPE_CHECKING:  # so that type checkers report these names

        def __getattr__(self, name: str) -> None:
            """Raise AttributeError for a name that a Trial does not have, with its remedy."""
            text = f"{type(self).__name__!r} object has no attribute {name!r}"
            if name[0] != "_" and "places" in vars(self):  # else of a copy that is not yet complete
                try:
                    self.find(name)
                except KeyError as error:
                    remedy = REMEDIES.get(name) or f"{error.args[0]}. Read a signal as in trial['knee.position']"
                    text = f"a trial has no attribute {name!r}: {remedy}"
            raise AttributeError(text, name=name, obj=self)

    def resample(self, rate: float) -> Trial:
        """Return this Trial at a fixed rate in Hz, from its first tick to its last, with missed ticks filled in.

        Floats are interpolated linearly, phases and bearings on the shorter way, quaternions at a constant rate; ints
        and bools keep their newest value. There is no filter: remove components above half the rate first.

        Raises BadInput for an empty Trial, or one that would not fit into memory.
        """
        return resample.resample_trial(self, rate)

    def strides(
        self,
        path: str,
        events: str | Sequence[float] | np.ndarray | None = None,
        points: int = 101,
        between: tuple[str, str] | None = None,
        last: int | None = None,
    ) -> np.ndarray:
        """Return a signal over the gait cycle, as (strides, points), or (strides, points, ...) for a vector.

        path : path of the signal
        events : times in s at which strides begin, such as heel strikes; or the path of a bool that becomes true there,
            or of a gait phase that falls from 1 to 0 there. By default the phase of the innermost subsystem of the
            signal that has one, while its `walking` is true
        points : samples of a stride, equally spaced
        between : times between which strides count: "mark 2", "start", "end", or seconds
        last : number of strides, the last ones; None for all

        Strides shorter than 0.4 s or longer than 4 s, or with a missing tick, are excluded. Raises KeyError or
        BadInput.
        """
        return strides.strides(self, path, events, points, between, last)

    def stride_times(
        self,
        path: str,
        events: str | Sequence[float] | np.ndarray | None = None,
        between: tuple[str, str] | None = None,
        last: int | None = None,
    ) -> np.ndarray:
        """Return the start and end of each stride of `strides`, as (strides, 2) in s.

        A stride twice as long as its neighbours is counted as two with a missed event.
        """
        self.find(path)
        return strides.bounds(self, path, events, between, last)

    def plot(
        self,
        *names: str,
        strides: bool = False,
        events: str | None = None,
        between: tuple[str, str] | None = None,
        last: int | None = None,
    ) -> Pictures:
        """Return pictures of signals, which a notebook shows; `.save("knee.png")` writes them.

        names : names of signals, blocks or subsystems, in one picture; by default a picture for each subsystem
        strides : whether to plot over the gait cycle instead of over time; without names, angle, torque and power of
            each joint
        events, between, last : with `strides`, as for Trial.strides

        Raises KeyError or BadInput.
        """
        from runtime.record.analysis import pictures
        from runtime.record.analysis.conditions import Condition

        if not strides and any(choice is not None for choice in (events, between, last)):
            raise BadInput("events, between and last select strides: add strides=True")
        if strides:
            condition = Condition(self.path.stem, self, events, between, last)
            return pictures.Pictures(pictures.over_strides([condition], names))
        return pictures.Pictures(pictures.over_time([self], names))

    def xdf(self, path: str | os.PathLike[str]) -> dict[str, Stream]:
        """Return {name: runtime.record.analysis.xdf.Stream} of an XDF file, with times on the axis of this trial.

        The file must contain the signals that an Lsl block sent in this run. Streams of the same name have their
        source_id in brackets: "EMG (amplifier 1)". Raises MissingExtra or BadInput.
        """
        from runtime.record.analysis.xdf import streams

        return streams(self, path)

    def clock(self, name: str, wrap: float = 0.0) -> Clock:
        """Return the runtime.record.analysis.clocks.Clock of a device, whose `time` are its readings at the ticks.

        name : block with a clock, such as an LslInlet, a Ros2Subscription or an Insole(clock=True), an inertial sensor,
            or the signal of a field with the clock of a Microcontroller, such as teensy.t
        wrap : s after which the counter of that signal wraps; 0 for never

        Raises BadInput without a recorded clock.
        """
        from runtime.record.analysis.clocks import clock

        return clock(self, name, wrap)

    def _repr_html_(self) -> str:
        from runtime.record.analysis.html import trial_in_html

        return trial_in_html(self)

    def table(self) -> pandas.DataFrame:
        """Return a pandas DataFrame with one row per tick, `time` as its index, and one column per number.

        `attrs` has the units and the fields of the trial. Raises MissingExtra.
        """
        return table.table(self)
