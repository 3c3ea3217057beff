"""The services of the recorder process by name: ours, and those of installed packages."""

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
LOGS = ("mcap", "candump")  # services of every recording with files; no Sink names them
