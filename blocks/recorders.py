"""Recorders. They have inputs only; the recorder process writes their files."""

from graph import Input, Param, Sink


class CsvRecorder(Sink):
    """CSV recorder: columns time, tick, and one per signal.

    Columns are named by block path and port, with the unit in ASCII.

    `record` selects the signals of the whole recording, also in its MCAP file: CsvRecorder(record="*/knee, imu.accel").
    A viewer without connections shows these signals, too. With every=4 it records every fourth tick. Several recorders
    record different signals at different rates.
    """

    record = Param(
        "",
        "1",
        "recorded signals, blocks or subsystems, such as left/knee.torque, right, */imu.accel; all by default",
        fixed=True,
    )
    delimiter = Param(",", "1", "column separator", choices=(",", ";", "\t"))
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
