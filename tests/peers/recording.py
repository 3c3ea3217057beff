"""The recorder beside csv.writer and the writer of the mcap package, which write the same rows, and rosbag2.

The figures of rosbag2 are published ones: its storage plugins alone, 100-byte messages that are already serialised, on
an Intel Core i5-7260U, to a RAM disk; median of 5 runs with a cache of 1 KiB. The recorder writes 4 messages a tick, of
122 bytes on average, and encodes them as well. (mcap.dev/guides/benchmarks/rosbag2-storage-plugins, November 2022)
"""

import csv
import io
import json
import time

from mcap.writer import CompressionType, Writer

from tests.bench import recorder_cost

MESSAGES = 4  # of a tick: two subsystems, the tick, the frames of a bus
ROSBAG2 = {"MCAP with zstd": 41.1e6, "SQLite": 18.0e6}  # bytes a second in messages of 100 bytes


def csv_writer(ticks):
    """Return s of processor time per row of csv.writer."""
    rows = [[tick / recorder_cost.RATE, tick, *recorder_cost.values(tick)] for tick in range(ticks)]
    file = io.StringIO()
    start = time.process_time()
    csv.writer(file).writerows(rows)
    return (time.process_time() - start) / ticks


def mcap_writer(ticks):
    """Return s of processor time per tick of mcap's writer: the same number of messages, encoded beforehand."""
    rows = [recorder_cost.tick_records(tick) for tick in range(ticks)]
    writer = Writer(io.BytesIO(), compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("row", "jsonschema", json.dumps({"type": "object"}).encode())
    channels = [writer.register_channel(name, "binary", schema) for name in ("drain", "bus", "row")]
    start = time.process_time()
    for tick, records in enumerate(rows):
        at = recorder_cost.PERIOD_NS * tick
        writer.add_message(channels[1], at, b"".join(payload[:24] for _, payload in records[1:5]), at)
        writer.add_message(channels[2], at, records[5][1], at)
    writer.finish()
    return (time.process_time() - start) / ticks


def measure(ticks):
    """Return {name: µs of processor time per tick}."""
    return {
        "Tickwork, MCAP with zstd": recorder_cost.measure(False, ticks)[0] * 1e6,
        "Tickwork, MCAP and CSV": recorder_cost.measure(True, ticks)[0] * 1e6,
        "csv.writer, rows alone": csv_writer(ticks) * 1e6,
        "mcap's writer with zstd, encoded": mcap_writer(ticks) * 1e6,
        **{f"rosbag2, {name} (published)": MESSAGES * 100 / rate * 1e6 for name, rate in ROSBAG2.items()},
    }
