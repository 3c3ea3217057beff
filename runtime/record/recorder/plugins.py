"""Services of the recorder process by name: modules of this package's `services` folder, and of installed packages.

The SERVICE of a module is its class. The `service` of a Sink is the name of the module.
"""

from runtime.host.plugins import Plugins, modules_of

SERVICES = Plugins(
    "tickwork.sinks",
    {name: f"{module}:SERVICE" for name, module in modules_of("runtime.record.recorder.services").items()},
)
LOGS = ("mcap", "candump")  # services of a recording with files, without a Sink
