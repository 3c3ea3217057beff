"""`bench bus`: that it measures what it says. How fast this machine is, is not tested."""

import json
import os
import socket

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


def test_bench_bus_reports_bus_cost_and_guardian_latency(command_line):
    code, out, err = command_line("bench", "bus", "--rounds", "200", "--trips", "3", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    for name in ("host_us", "calls_us", "direct_us", "guardian_us"):
        assert 0.0 < told["bus"][name]["p50"] <= told["bus"][name]["p99"] <= told["bus"][name]["max"], name


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
