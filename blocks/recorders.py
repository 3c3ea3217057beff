"""Recorders. They have inputs only; the recorder process writes their files."""

from graph import Input, Param, Sink

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", "pipe": "|"}


class CsvRecorder(Sink):
    """CSV recorder: columns time, tick, and one per signal.

    Columns are named by block path and port, with the unit in ASCII.

    `record` selects the signals of the whole recording, also in its MCAP file: CsvRecorder(record="*/knee, imu.accel").
    A viewer without connections also shows these signals. With every=4 it records every fourth tick. Several recorders
    record different signals at different rates.

    CsvRecorder(names={"left/knee.position": "knee_angle"}, text=True) renames a column, writes states by their names,
    and adds the column `events`.
    """

    record = Param(
        "",
        "1",
        "recorded signals, blocks or subsystems, such as left/knee.torque, right, */imu.accel; all by default",
        fixed=True,
    )
    delimiter = Param(
        ",", "1", "column separator: comma, semicolon, tab, space, pipe, or a character that is in no number", dtype=str
    )
    names = Param({}, "1", "column names of your own, as {signal: name}, written without a unit", dtype=dict)
    text = Param(
        False,
        "1",
        "true writes states of a StateMachine by name, and the column `events`: marks, changes, warnings and faults",
        fixed=True,
    )
    flush_rows = Param(200, "1", "number of rows between flushes to the disk", min=1, fixed=True)
    time = Param(
        "relative",
        "1",
        "time column: s since tick 0 (relative) or s since 1970 by the computer's clock (device)",
        choices=("relative", "device"),
    )
    overwrite = Param(
        False, "1", "true replaces an existing file; false adds a number to the new file's name", fixed=True
    )
    during = Param(
        "", "1", "recorded signal, such as mocap.on: only ticks in which it is true become rows; all ticks by default"
    )
    file = Param("", "1", "file name without extension; the diagram's name and the time by default")

    service, writes_files, accepts_every = "csv", True, True

    def configure(self) -> None:
        self.delimiter = separator = SEPARATORS.get(self.delimiter, self.delimiter)
        if len(separator) != 1 or separator.isalnum() or separator in '.+-"\r\n':
            raise ValueError(
                f"delimiter must be {', '.join(SEPARATORS)}, or one character that is in no number and no quote, got "
                f"{separator!r}"
            )
        for signal, name in self.names.items():
            if not (isinstance(signal, str) and isinstance(name, str) and name.strip() == name != ""):
                raise ValueError(f"names must be {{signal: name}}, both text, got {signal!r}: {name!r}")


class StrideReport(Sink):
    """Report of one leg's average stride: number of strides, work, and a plot at the end of the run.

    The plot shows angle and torque over the gait phase. Positive work is W⁺ = ∫ max(τ ω, 0) dt over a stride.
    """

    title = Param("", "1", "name of the leg; the name of the subsystem by default")
    positive = Param("", "1", "direction of positive angles and torques, such as flexion, for the axes of plots")

    phase = Input("1", "gait phase, 0 at heel strike")
    walking = Input("1", "true while the phase is known", dtype=bool)
    angle = Input("rad", "joint angle")
    velocity = Input("rad/s", "joint velocity")
    torque = Input("N·m", "torque of the drive")

    variadic = False
    service, writes_files = "strides", True
