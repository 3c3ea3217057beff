"""One process of `bench ros2`: `python -m tests.bench.ros2_process ROLE ...`. It prints a line when it is ready.

router PLACE                                  until it is killed
subscriber PLACE DOMAIN                       until a line arrives; prints [grid time, time of put, arrival, bytes]
publisher PLACE DOMAIN RATE TICKS SIZES       messages of these sizes at each tick
"""

from __future__ import annotations

import json
import sys
import time
from struct import Struct
from typing import Any

from runtime.host.optional_dependencies import need

zenoh = need("zenoh", "ROS 2")
ATTACHMENT, STAMP = Struct("<qqB16s"), Struct("<4xiI")  # CDR's header, seconds and nanoseconds
CONNECTED = 0.5  # s


def session(mode: str, connect: str = "", listen: str = "tcp/localhost:0") -> Any:
    """Return a session of Zenoh."""
    config = zenoh.Config()
    settings = {
        "mode": mode,
        "connect/endpoints": [connect] if connect else [],
        "listen/endpoints": [listen],
        "scouting/multicast/enabled": False,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def router(place: str) -> None:
    """Route until killed."""
    kept = session("router", listen=place)
    print("ready", flush=True)
    sys.stdin.read()
    kept.close()


def subscriber(place: str, domain: str) -> None:
    """Take the messages of joints and sensors, and print their times."""
    taken = []

    def take(sample: Any) -> None:
        taken.append((time.time_ns(), str(sample.key_expr), bytes(sample.payload), bytes(sample.attachment)))

    kept = session("peer", place)
    subscription = kept.declare_subscriber(f"{domain}/**", take)
    print("ready", flush=True)
    sys.stdin.readline()
    time.sleep(0.2)  # those on their way
    subscription.undeclare()
    rows = []
    for arrival, key, payload, attachment in taken:
        if "diagnostics" not in key:
            seconds, nanoseconds = STAMP.unpack_from(payload)
            rows.append(
                (seconds * 1_000_000_000 + nanoseconds, ATTACHMENT.unpack(attachment)[1], arrival, len(payload))
            )
    print(json.dumps(rows), flush=True)


def publisher(place: str, domain: str, rate: str, ticks: str, sizes: str) -> None:
    """Publish as runtime.host.ros2_node does, at absolute times."""
    kept = session("peer", place)
    options = {"congestion_control": zenoh.CongestionControl.DROP, "express": True}
    lengths = json.loads(sizes)
    publishers = [kept.declare_publisher(f"{domain}/bare{number}", **options) for number in range(len(lengths))]
    time.sleep(CONNECTED)
    print("ready", flush=True)
    began = time.time_ns()
    for tick in range(1, int(ticks) + 1):
        grid = began + tick * 1_000_000_000 // int(rate)
        time.sleep(max(0, grid - time.time_ns()) * 1e-9)
        for each, length in zip(publishers, lengths):
            data = STAMP.pack(*divmod(grid, 1_000_000_000)).ljust(length, b"\0")
            each.put(data, attachment=ATTACHMENT.pack(tick, time.time_ns(), 16, bytes(16)))
    time.sleep(CONNECTED)


if __name__ == "__main__":
    {"router": router, "subscriber": subscriber, "publisher": publisher}[sys.argv[1]](*sys.argv[2:])
