"""Recorders: what becomes of a run. They only take; the recorder process serves them."""

from graph import Input, Param, Sink


class CsvRecorder(Sink):
    """Writes its signals as a CSV file: time, tick, and one column a signal, named by block path and port with its unit
    in ASCII.
    """

    delimiter = Param(",", "1", "between columns", choices=(",", ";", "\t"))
    flush_rows = Param(200, "1", "rows between flushes to the disk", min=1, fixed=True)
    time = Param(
        "relative",
        "1",
        "relative: s since tick 0; device: s since 1970 by the clock of the computer",
        choices=("relative", "device"),
    )
    overwrite = Param(False, "1", "whether a file of this name is replaced; else the new one gets a number", fixed=True)
    during = Param(
        "", "1", "signal among its own, such as mocap.on: rows only of ticks in which that is true; by default of all"
    )
    file = Param("", "1", "name of the file without its ending; the diagram's name and the time by default")

    service, writes_files = "csv", True


class StrideReport(Sink):
    """The average stride of one leg: counts strides, sums work, and draws angle and torque over the gait phase at the
    end of a run.

    Work is positive where the drive pushes the way the joint moves: W⁺ = ∫ max(τ ω, 0) dt, over a stride.
    """

    title = Param("", "1", "name of the leg; the subsystem's by default")

    phase = Input("1", "gait phase, 0 at heel strike")
    walking = Input("1", "whether the phase is known", dtype=bool)
    angle = Input("rad", "joint angle")
    velocity = Input("rad/s", "joint velocity")
    torque = Input("N·m", "what the drive gives")

    variadic = False
    service, writes_files = "strides", True
