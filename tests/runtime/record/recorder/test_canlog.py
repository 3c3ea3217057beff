"""The CAN log: what python-can's own reader finds in it."""

import time

import pytest
from can.io.canutils import CanutilsLogReader

from cext.memory.shared_state import SharedState
from tests.runtime.record.recorder.running import frame, leg, plan, record, run

pytestmark = pytest.mark.paced

EXTENDED, REMOTE = 0x80000000, 0x40000000


def log(path):
    return list(CanutilsLogReader(path))


def test_every_frame_has_bus_direction_time_and_data(tmp_path):
    frames = [frame(k * 1_000_000, 1 + k % 3, bytes([k % 256, 7]), sent=k % 2, bus=k % 2) for k in range(3000)]
    report = record(plan(tmp_path, buses=["legs", "arms"]), frames)
    messages = log(tmp_path / "bench_1.can.log")
    assert len(messages) == 3000 and report["sinks"]["CAN log"]["frames"] == 3000
    for k, message in enumerate(messages):
        assert message.timestamp == pytest.approx(k * 1e-3, abs=1e-6)
        assert message.arbitration_id == 1 + k % 3 and message.data == bytes([k % 256, 7])
        assert message.is_rx is (k % 2 == 0) and message.channel == ("legs", "arms")[k % 2]


def test_extended_remote_long_and_empty_frames_keep_their_kind(tmp_path):
    record(
        plan(tmp_path, buses=["legs"]),
        [
            frame(0, 0x0801 | EXTENDED, b"\1\2"),
            frame(0, 0x7 | EXTENDED, b""),
            frame(0, 0x123 | REMOTE, b""),
            frame(0, 5, bytes(range(64)), flags=4 | 1),
            frame(0, 6, b"\xff", flags=4),
        ],
    )
    extended, small, remote, long, flexible = log(tmp_path / "bench_1.can.log")
    assert extended.is_extended_id and extended.arbitration_id == 0x801
    assert small.is_extended_id and small.arbitration_id == 7 and small.data == b""
    assert remote.is_remote_frame and remote.arbitration_id == 0x123 and not remote.is_extended_id
    assert long.is_fd and long.bitrate_switch and long.data == bytes(range(64))
    assert flexible.is_fd and not flexible.bitrate_switch and flexible.data == b"\xff"


def test_frames_keep_receive_time_regardless_of_read_order(tmp_path):
    record(plan(tmp_path, buses=["a", "b"]), [frame(5_000_000, 1, b"", bus=0), frame(3_000_000, 2, b"", bus=1)])
    assert [message.timestamp for message in log(tmp_path / "bench_1.can.log")] == [0.005, 0.003]


def test_in_real_time_the_log_shows_the_wall_clock(tmp_path):
    diagram, plant = leg()
    start = time.time()
    run(diagram, tmp_path, 20, plant=plant, virtual=False)
    stamps = [message.timestamp for message in log(tmp_path / "leg.can.log")]
    assert start < stamps[0] < stamps[0] + 19 / 200 < stamps[-1] < time.time()  # arming, 20 ticks, the safe stop


def test_the_last_frames_of_a_run_on_disk_are_zero_torque_then_disable(tmp_path):
    diagram, plant = leg()
    outcome, report, _ = run(diagram, tmp_path, 50, plant=plant)
    assert outcome.status == "ok"
    sent = [message.data.hex() for message in log(tmp_path / "leg.can.log") if not message.is_rx]
    assert sent[0] == "fffffffffffffffc"  # enable
    assert sent[-2:] == ["7fff7ff0000007ff", "fffffffffffffffd"]  # zero torque, disable (protocols.md 1.1)
    assert sent.count("fffffffffffffffd") == 2  # the replies to the first may be those to earlier commands


def test_a_full_ring_costs_no_frame_in_virtual_time(tmp_path):
    diagram, plant = leg()
    outcome, report, shared = run(diagram, tmp_path, 2000, plant=plant, shared=SharedState(1 << 14))
    assert outcome.status == "ok" and report["dropped"] == 0 and report["end"]["status"] == "ok"
    counted = shared.statistics()["frames"]
    assert len(log(tmp_path / "leg.can.log")) == counted["sent"] + counted["received"] > 4000
