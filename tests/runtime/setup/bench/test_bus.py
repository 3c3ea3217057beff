"""`bench bus` and `bench deaths`: that they measure what they say. How fast this machine is, is not tested."""

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


def test_bench_bus_reports_bus_cost_and_guardian_latency(command_line):
    code, out, err = command_line("bench", "bus", "--rounds", "200", "--trips", "3", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    for name in ("host_us", "calls_us", "direct_us", "guardian_us"):
        assert 0.0 < told["bus"][name]["p50"] <= told["bus"][name]["p99"] <= told["bus"][name]["max"], name
    assert [goal["what"] for goal in told["goals"]][0] == "a bus, without its two system calls"


def test_bench_deaths_measures_each_death_and_leaves_no_process(command_line):
    before = set(psutil.Process().children())
    code, out, err = command_line("bench", "deaths", "--kills", "1", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "") and told["load"]["min"] <= told["load"]["max"]
    measured = [each for each in told["deaths"].values() if each["n"]]
    assert len(told["deaths"]) == 4 and len(measured) >= 3, "one may lack its real-time priority"
    assert all((each["n"], each["missed"]) == (1, 0) and 0.0 < each["p50"] == each["max"] < 900.0 for each in measured)
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
