"""`python -m runtime bench sensors`."""

from dataclasses import asdict

from runtime.base.errors import OK, BadInput
from runtime.bench import goals
from runtime.bench.report import Report, machine, words
from runtime.cli.bench.options import add_options
from runtime.cli.parsing import Parser


def main(arguments):
    """Run the command. Returns the exit code."""
    parser = Parser(
        "bench sensors",
        "Measure what eight inertial sensors at 500 Hz each cost on "
        "pseudo-terminals, what they do to a loop "
        "beside them, how fast their packets are read, and what the thread of an I2C "
        "bus costs by itself.",
    )
    add_options(parser, seconds=2.0, repeats=5, realtime=True, seconds_limit=600.0)
    options = parser.parse_args(arguments)
    from runtime.bench import i2c, sensors
    from runtime.machine.realtime import RealtimeRefused

    report = Report(options.json)
    report.say(
        [
            f"{options.repeats} chunks of {options.seconds:g} s of each, taken in turn; --realtime {options.realtime}",
            *words(),
        ],
        **machine(),
    )
    try:
        alone, beside = sensors.measure(options.seconds, options.repeats, options.realtime)
    except (OSError, RealtimeRefused) as error:
        raise BadInput(str(error)) from None
    found = sensors.summary(alone, beside, *sensors.parsed(3 * options.repeats))
    report.say(
        [
            "",
            f"{f'a loop at {sensors.LOOP:g} Hz':46}{'late, µs: p50':>16}{'p99':>9}{'processor':>11}{'missed':>8}",
            *(
                f"  {label:44}{found['late_p50_us'][name]:16.1f}{found['late_p99_us'][name]:9.1f}"
                f"{found[share]:11.2%}{found['missed'][name]:8}"
                for label, name, share in (
                    ("alone", "alone", "processor_alone"),
                    (f"beside {sensors.SENSORS} sensors at {sensors.RATE:g} Hz", "beside", "processor"),
                )
            ),
            f"  {found['packets']} packets came; {found['lost']} samples lost, {found['corrupt']} packets corrupt, "
            f"{found['overflows']} chunks written over",
            "",
            f"{'packets read':46}{'MB/s':>16}",
            f"  {'natively':44}{found['native_mb_s']:16.0f}",
            f"  {'in Python':44}{found['python_mb_s']:16.1f}",
        ],
        sensors=found,
    )
    cost = i2c.measure(options.seconds)
    report.say(
        [
            "",
            f"{'a thread of an I2C bus, on chips in memory':46}{'exchanges a second':>20}{'µs of each':>12}"
            f"{'processor':>11}",
            f"  {f'{i2c.SENSORS} IMUs at {i2c.RATE:g} Hz behind a multiplexer':44}{cost.exchanges:20.0f}"
            f"{cost.each * 1e6:12.2f}{cost.processor:11.2%}",
            "  the adapter's driver adds 0.4 ms of waiting a burst at 400 kbit/s, and its interrupts",
        ],
        i2c=asdict(cost),
    )
    report.goals += goals.of_sensors(found)
    report.finish()
    return OK
