"""`python -m tests.bench sensors`: that it measures what it says. How fast this machine is, is not tested."""

import json

import pytest

from blocks.families import benchmark
from runtime.host.errors import OK
from tests.bench import sensors

pytestmark = [pytest.mark.timing, pytest.mark.soak]


def test_bench_sensors_reports_cost_and_losses(bench):
    code, out, err = bench("sensors", "--seconds", "0.2", "--repeats", "1", "--json")
    told = json.loads(out)
    assert (code, err) == (OK, "")
    found = told["sensors"]
    assert 8 * 2 * 500 * 0.15 < found["packets"] < 8 * 2 * 500 * 0.4 and found["corrupt"] == found["overflows"] == 0
    assert 0.0 < found["processor"] < 1.0 and found["native_mb_s"] > found["python_mb_s"] > 0.0
    assert all(0.0 < found[name][row] for name in ("late_p50_us", "late_p99_us") for row in ("alone", "beside"))
    # 3 (200 + 100) answers, checks, two switches a round
    assert 1200.0 < told["i2c"]["exchanges"] < 1450.0 and 850.0 < told["i2c"]["answers"] < 960.0
    assert 0.0 < told["i2c"]["processor"] < 0.5
    assert [goal["unit"] for goal in told["goals"]] == ["", "", "times", "MB/s", "times"]


def test_both_parsers_read_every_packet_of_the_stream():
    from blocks.imus.microstrain import mip

    typical = benchmark("stream")
    data = typical.stream(sensors.PACKETS, sensors.RATE)
    packets, rest, corrupt = mip.split(data)
    assert len(packets) == 2 * sensors.PACKETS and not rest and not corrupt
    assert set(typical.parse(data[:2000])) <= {
        "accel",
        "gyro",
        "mag",
        "temperatures",
        "sensor_time",
        "filter_time",
        "filter_quaternion",
    }
