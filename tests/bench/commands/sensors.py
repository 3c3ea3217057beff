"""`python -m tests.bench sensors`."""

from collections.abc import Sequence
from dataclasses import asdict

from runtime.cli.bench.options import add_options
from runtime.host.errors import BadInput
from runtime.setup.bench.report import Report, machine, machine_lines
from tests.bench.parsing import parser_of


def measure_and_print(arguments: Sequence[str]) -> Report:
    """Measure, and print the tables. Returns the Report."""
    parser = parser_of(
        "sensors",
        "Measure the cost of eight inertial sensors at 500 Hz on pseudo-terminals, their effect on the lateness of the "
        "loop, the speed of their packet parser, and the cost of the thread of an I2C bus.",
    )
    add_options(parser, seconds=2.0, repeats=5, realtime=True, seconds_limit=600.0)
    options = parser.parse_args(arguments)
    from runtime.host.machine.realtime import RealtimeRefused
    from tests.bench import i2c, sensors

    report = Report(options.json)
    report.say(
        [
            f"{options.repeats} alternating chunks of {options.seconds:g} s each; --realtime {options.realtime}",
            *machine_lines(),
        ],
        **machine(),
    )
    try:
        alone, beside = sensors.measure(options.seconds, options.repeats, options.realtime)
    except (OSError, RealtimeRefused) as error:
        raise BadInput(str(error)) from None
    results = sensors.summary(alone, beside, *sensors.parsed(3 * options.repeats))
    report.say(
        [
            "",
            f"{f'a loop at {sensors.LOOP:g} Hz':46}{'late, µs: p50':>16}{'p99':>9}{'processor':>11}{'missed':>8}",
            *(
                f"  {label:44}{results['late_p50_us'][name]:16.1f}{results['late_p99_us'][name]:9.1f}"
                f"{results[share]:11.2%}{results['missed'][name]:8}"
                for label, name, share in (
                    ("alone", "alone", "processor_alone"),
                    (f"with {sensors.SENSORS} sensors at {sensors.RATE:g} Hz", "beside", "processor"),
                )
            ),
            f"  {results['packets']} packets received; {results['lost']} samples lost, "
            f"{results['corrupt']} packets corrupt, "
            f"{results['overflows']} chunks overwritten",
            "",
            f"{'packet parser':46}{'MB/s':>16}",
            f"  {'native':44}{results['native_mb_s']:16.0f}",
            f"  {'in Python':44}{results['python_mb_s']:16.1f}",
        ],
        sensors=results,
    )
    cost = i2c.measure(options.seconds)
    report.say(
        [
            "",
            f"{'thread of an I2C bus, chips in memory':46}{'exchanges/s':>20}{'µs each':>12}{'processor':>11}",
            f"  {f'{i2c.SENSORS} IMUs at {i2c.RATE:g} Hz behind a multiplexer':44}{cost.exchanges:20.0f}"
            f"{cost.each * 1e6:12.2f}{cost.processor:11.2%}",
            "  the driver of a real adapter adds interrupts, and 0.4 ms of waiting per burst at 400 kbit/s",
        ],
        i2c=asdict(cost),
    )
    return report
