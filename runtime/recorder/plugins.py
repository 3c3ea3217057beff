"""Services of the recorder process by name: of this package and of installed packages."""

from runtime.base.plugins import Plugins

SERVICES = Plugins(
    "tickwork.sinks",
    {
        "mcap": "runtime.recorder.mcap:FlightLog",
        "candump": "runtime.recorder.canlog:CanLog",
        "csv": "runtime.recorder.csv:CsvWriter",
        "strides": "runtime.recorder.strides:StrideAverage",
        "plotjuggler": "runtime.recorder.plotjuggler:PlotJugglerSender",
        "rerun": "runtime.recorder.rerun.sender:RerunSender",
    },
)
LOGS = ("mcap", "candump")  # services of a recording with files, without a Sink
