"""`python -m runtime bench bus`: that it measures what it says. How fast this machine is, is not tested."""

import json
import os
import socket

import psutil
import pytest

from cext.bus.socketcan import SocketCan
from cext.schedule.bus_cost import time_of_ticks
from runtime.host.errors import OK


@pytest.fixture
def ends():
    """A SocketCan, its socket, and the socket at the other end."""
    own, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    with own, other:
        for end in (own, other):
            end.bind(("127.0.0.1", 0))
        own.connect(other.getsockname())
        other.connect(own.getsockname())
        yield SocketCan(own), own, other


def test_bench_bus_reports_bus_cost_guardian_latency_and_stop_time(command_line):
    before = set(psutil.Process().children())
    code, out, err = command_line("bench", "bus", "--rounds", "200", "--trips", "3", "--kills", "2", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    found = told["bus"]
    for name in ("host_us", "calls_us", "direct_us", "guardian_us", "stop_ms"):
        assert 0.0 < found[name]["p50"] <= found[name]["p99"] <= found[name]["max"], name
    assert found["missed"] == 0 and found["stop_ms"]["max"] < 500.0
    assert [goal["what"] for goal in told["goals"]][0] == "a bus, without its two system calls" and len(
        told["goals"]
    ) == 6
    assert list(found["guardian_deaths_ms"]) == ["udp_multicast", "slcan"] and found["guardian_deaths_missed"] == 0
    stops = [*found["guardian_deaths_ms"].values(), found["guardian_halts_ms"]]
    assert all(0.0 < each["p50"] <= each["max"] < 500.0 for each in stops)
    left = set(psutil.Process().children()) - before
    assert [child for child in left if child.status() != psutil.STATUS_ZOMBIE and not is_server(child)] == []


def is_server(process):
    """Whether it is the server of the commands of these tests, which stays (tests/runtime/forked.py)."""
    return any("tests.runtime.forked" in word for word in process.cmdline())


def test_both_buses_carry_every_frame_in_every_round(ends):
    bus, own, other = ends
    through, alone = time_of_ticks(bus.end, own.fileno(), other.fileno(), 8, 50)
    assert len(through) == len(alone) == 50 and min(through) > 0 and min(alone) > 0
    assert bus.counts["corrupt"] == bus.counts["echoes"] == 0


def test_a_round_with_a_lost_frame_is_not_counted(ends):
    bus, own, other = ends
    with pytest.raises(ValueError, match="1 to 64 frames, not 65"):
        time_of_ticks(bus.end, own.fileno(), other.fileno(), 65, 1)
    with pytest.raises(OSError), open(os.devnull) as nowhere:
        time_of_ticks(bus.end, own.fileno(), nowhere.fileno(), 8, 1)
