"""Viewers: where a run can be watched. They only take; the recorder process serves them."""

from graph import Param, Sink


class PlotJuggler(Sink):
    """Streams its signals to PlotJuggler: one UDP datagram a tick, JSON nested by block path, with a `timestamp` in s.

    In PlotJuggler: Streaming, UDP Server, port 9870, JSON; tick "use field as timestamp" and enter `timestamp`.
    """

    host = Param("127.0.0.1", "1", "where PlotJuggler runs")
    port = Param(9870, "1", "its UDP port", min=1, max=65535, fixed=True)

    service = "runtime.recorder.plotjuggler:PlotJugglerSender"
