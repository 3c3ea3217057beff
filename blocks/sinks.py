"""Viewers: where a run can be watched. They only take; the recorder process serves them."""

from graph import Param, Sink


class PlotJuggler(Sink):
    """Streams its signals to PlotJuggler over UDP: JSON nested by block path, with a `timestamp` in s in every message.

    PlotJuggler sorts by that stamp and throws away what is older than its buffer, so that a second run whose time began
    at 0 again would not be seen: the stamps go on rising from one run to the next, and "remove time offset", which is
    on by default, shows them from 0.

    In PlotJuggler: Streaming, UDP Server, port 9870, JSON; tick "use field as timestamp" and enter `timestamp`.
    `python -m runtime plotjuggler FILE` makes a layout with its plots.
    """

    host = Param("127.0.0.1", "1", "where PlotJuggler runs")
    port = Param(9870, "1", "its UDP port", min=1, max=65535, fixed=True)

    signals = Param(
        "",
        "1",
        "which of its signals, as in left/knee.torque, right, */imu.accel: signals, blocks, subsystems; all by default",
    )
    decimation = Param(1, "1", "one tick of so many is sent", min=1, max=10_000, fixed=True)
    time = Param(
        "device",
        "1",
        "of the timestamp; device: s since 1970 by the clock of the computer; relative: s since tick 0",
        choices=("device", "relative"),
        fixed=True,
    )
    batch = Param(1, "1", "samples in a datagram; more than 1 needs PlotJuggler 3.16", min=1, max=1000, fixed=True)

    service = "plotjuggler"


class Rerun(Sink):
    """Shows its signals in Rerun: a plot a subsystem with its limits, limbs in 3-D, faults as text. Needs rerun-sdk:
    pip install 'tickwork[rerun]'.

    A limb is found by its names: in one subsystem, actuators called `hip`, `knee` and `ankle`.
    """

    target = Param(
        "",
        "1",
        "a file.rrd; serve, or serve:ADDRESS, for a browser; HOST:PORT of a viewer; or nothing, "
        "for one on this machine",
    )
    port = Param(9876, "1", "of the viewer, or of the server", min=1, max=65535, fixed=True)
    web_port = Param(9090, "1", "of the page that the server has for browsers", min=1, max=65535, fixed=True)

    service = "rerun"
