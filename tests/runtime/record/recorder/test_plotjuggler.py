"""The PlotJuggler sink: what a program that listens on UDP receives."""

import json
import math
import socket
import subprocess
import sys
import time

import pytest

from blocks.sinks import PlotJuggler
from runtime.host.errors import BadInput
from runtime.record.recorder import RecorderError
from runtime.record.recorder.services.plotjuggler import PlotJugglerSender
from runtime.robot.loading.signal_selection import select
from tests.runtime.record.recorder.running import JUGGLER, columns, counting, plan, record, row, run, sink

VECTOR = ["left/imu.accel[0] m/s²", "left/imu.accel[1] m/s²", "left/imu.accel[2] m/s²"]


def strict(datagram):
    """JSON as a strict parser takes it: NaN and Infinity are none."""

    def refuse(word):
        raise ValueError(word)

    return json.loads(datagram, parse_constant=refuse)


class Listener:
    def __init__(self, family=socket.AF_INET, address="127.0.0.1"):
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 8 << 20)
        self.socket.bind((address, 0))
        self.host, self.port = address, self.socket.getsockname()[1]

    def heard(self):
        """All messages that have arrived."""
        self.socket.setblocking(False)
        messages = []
        while True:
            try:
                messages.append(strict(self.socket.recv(1 << 16)))
            except BlockingIOError:
                return messages


@pytest.fixture
def listener():
    listener = Listener()
    yield listener
    listener.socket.close()


def here(columns_, **parameters):
    """The sink, with the time of the run for its stamps."""
    return sink(JUGGLER, "juggler", columns_, **{"time": "relative", **parameters})


def send(listener, signals, records):
    report = record(plan(None, here(signals, host=listener.host, port=listener.port)), records)
    return report["sinks"]["juggler"], listener.heard()


def test_each_tick_is_one_message_nested_by_block_path(listener):
    signals = columns(
        "left/knee.position rad",
        "left/knee.torque N·m",
        "right/knee.position rad",
        "gait.walking 1 bool",
        "gait.steps 1 int",
    )
    result, messages = send(listener, signals, [row(tick, 0.1 * tick, 2.0, 3.0, tick % 2, tick) for tick in range(100)])
    assert result["datagrams"] == 100 and result["lost"] == 0
    assert messages == [
        {
            "timestamp": tick / 200.0,
            "left": {"knee": {"position": 0.1 * tick, "torque": 2.0}},
            "right": {"knee": {"position": 3.0}},
            "gait": {"walking": bool(tick % 2), "steps": tick},
        }
        for tick in range(100)
    ]


def test_the_block_in_a_running_diagram_sends_every_tick_of_the_run(listener, tmp_path):
    diagram = counting()
    with diagram:
        PlotJuggler(host=listener.host, port=listener.port, time="relative")
    _, _, page = run(diagram, tmp_path, 100, virtual=False)
    messages = listener.heard()
    assert [message["timestamp"] for message in messages] == sorted(message["timestamp"] for message in messages)
    assert 0 < len(messages) == page.statistics()["ticks"]
    assert all(message["counter"]["value"] == pytest.approx(20 * message["timestamp"]) for message in messages)


@pytest.mark.parametrize("virtual", [True, False])
def test_second_run_continues_time_of_first(listener, virtual):
    """PlotJuggler keeps the newest 60 s by their stamps: of a run that began at 0 again it would show nothing until it
    is older than the first.
    """
    diagram, began, stamps = counting(), time.time(), []
    with diagram:
        PlotJuggler(host=listener.host, port=listener.port)
    for _ in range(2):
        run(diagram, None, 20, virtual=virtual)
        stamps.append([message["timestamp"] for message in listener.heard()])
        time.sleep(0.1 if virtual else 0.0)
    first, second = stamps
    assert began < first[0] and first[-1] < second[0] and second[-1] < time.time() + 1.0
    ticks = [200 * (at - second[0]) for at in second]  # in real time some may be missed
    assert (
        ticks == pytest.approx([round(tick) for tick in ticks], abs=1e-3) and ticks == sorted(ticks) and ticks[-1] < 20
    )
    assert len(ticks) == 20 or not virtual


CHOICE = columns(
    "left/knee.position rad",
    "left/knee.torque N·m",
    "left/imu.accel[0] m/s²",
    "left/imu.accel[1] m/s²",
    "right/knee.torque N·m",
    "clock.t s",
)


@pytest.mark.parametrize(
    "text, places",
    [
        ("", [0, 1, 2, 3, 4, 5]),
        ("left/knee.torque", [1]),
        ("left/knee", [0, 1]),
        ("left", [0, 1, 2, 3]),
        ("*.torque", [1, 4]),
        ("*/imu.accel", [2, 3]),
        ("left/imu.accel[1]", [3]),
        (" clock , */knee.t* ", [1, 4, 5]),
        ("?eft/knee.position", [0]),
    ],
)
def test_signals_are_chosen_by_name(text, places):
    assert select(CHOICE, text) == places


@pytest.mark.parametrize(
    "text, words",
    [
        ("left/knee.torqe", "no signal 'left/knee.torqe'; did you mean 'left/knee.torque'"),
        ("rihgt", "did you mean 'right'"),
        ("left, x*z", r"no signal 'x\*z'; as in left/knee.position"),
    ],
)
def test_unknown_name_is_reported_with_suggestion(text, words):
    with pytest.raises(BadInput, match=words):
        select(CHOICE, text)


def test_only_selected_signals_are_sent(listener):
    juggler = here(CHOICE, host=listener.host, port=listener.port, signals="*.torque, left/imu.accel[1]")
    record(plan(None, juggler), [row(0, *range(6))])
    assert listener.heard() == [
        {
            "timestamp": 0.0,
            "left": {"knee": {"torque": 1.0}, "imu": {"accel": [None, 3.0]}},
            "right": {"knee": {"torque": 4.0}},
        }
    ]


def test_vectors_are_arrays_and_keep_their_indices(listener):
    signals = columns(*VECTOR, "m.r[0][1] 1", "m.r[1][1] 1", "b.y[2] 1")
    _, messages = send(listener, signals, [row(0, 1, 2, 3, 4, 5, 6)])
    assert messages[0]["left"] == {"imu": {"accel": [1.0, 2.0, 3.0]}}
    assert messages[0]["m"] == {"r": [[None, 4.0], [None, 5.0]]} and messages[0]["b"] == {"y": [None, None, 6.0]}


def test_non_finite_value_becomes_null(listener):
    signals = columns("a.x m", "a.y m", "a.n 1 int", "a.b 1 bool")
    _, messages = send(
        listener, signals, [row(0, math.nan, math.inf, math.nan, math.nan), row(1, -math.inf, 1.0, math.inf, 1.0)]
    )
    assert messages == [
        {"timestamp": 0.0, "a": {"x": None, "y": None, "n": None, "b": None}},
        {"timestamp": 0.005, "a": {"x": None, "y": 1.0, "n": None, "b": True}},
    ]


def test_a_signal_named_timestamp_does_not_replace_the_timestamp(listener):
    _, messages = send(listener, columns("timestamp s", "timestamp_ s"), [row(3, 77.0, 78.0)])
    assert messages == [{"timestamp": 0.015, "timestamp_": 77.0, "timestamp__": 78.0}]


def test_conflicting_paths_are_all_exported(listener):
    _, messages = send(
        listener, columns("a m", "a.b m", "a.b.c m", "d.e m", "d m", "d[0] m", "a m"), [row(0, 1, 2, 3, 4, 5, 6, 7)]
    )
    flat = json.dumps(messages[0])
    assert all(f"{value}.0" in flat for value in range(1, 8)) and messages[0]["timestamp"] == 0.0


def test_oversized_message_is_split_by_subsystem_with_timestamp(listener):
    sides = [f"{side}/{'block' * 12}{index}.signal 1" for side in ("left", "right") for index in range(600)]
    result, messages = send(listener, columns(*sides), [row(tick, *range(1200)) for tick in range(2)])
    assert len(messages) == result["datagrams"] == 4
    assert [(message["timestamp"], *(set(message) - {"timestamp"})) for message in messages] == [
        (0.0, "left"),
        (0.0, "right"),
        (0.005, "left"),
        (0.005, "right"),
    ]
    assert messages[1]["right"]["block" * 12 + "599"]["signal"] == 1199.0


def test_many_subsystems_need_few_datagrams(listener):
    """Not one datagram for each of them."""
    signals = columns(*(f"{'side' * 12}{index}/block.signal 1" for index in range(1000)))
    result, messages = send(listener, signals, [row(1, *range(1000))])
    assert result["datagrams"] == len(messages) == 2
    assert sorted(len(message) for message in messages) == [501, 501]


def test_one_large_subsystem_is_divided_further(listener):
    signals = columns(*(f"left/block.{'signal' * 12}{index} 1" for index in range(1500)))
    _, messages = send(listener, signals, [row(1, *range(1500))])
    assert len(messages) > 1 and all(message["timestamp"] == 0.005 for message in messages)
    merged = {name: value for message in messages for name, value in message["left"]["block"].items()}
    assert merged == {f"{'signal' * 12}{index}": float(index) for index in range(1500)}


def test_ipv6_destination_is_supported():
    try:
        listener = Listener(socket.AF_INET6, "::1")
    except OSError:
        pytest.skip("this machine has no IPv6")
    _, messages = send(listener, columns("a.x m"), [row(0, 1.0)])
    listener.socket.close()
    assert messages == [{"timestamp": 0.0, "a": {"x": 1.0}}]


def test_refused_datagrams_are_counted_and_reported_once(tmp_path, capfd):
    signals = columns("a.x m")
    broadcast = here(signals, host="255.255.255.255", port=9870)  # was not asked for: EACCES
    report = record(plan(tmp_path, broadcast), [row(tick, 1.0) for tick in range(10)])
    assert report["sinks"]["juggler"]["lost"] == 10 and report["sinks"]["juggler"]["trouble"] == "Permission denied"
    assert report["ticks"] == 10 and report["problems"] == []
    assert capfd.readouterr().err == (
        "tickwork: juggler: cannot send to 255.255.255.255 port 9870 (Permission denied); the run continues\n"
    )


ROAMING = """
import subprocess
from runtime.record.recorder.services import plotjuggler

def ip(*words):
    subprocess.run(["ip", *words], check=True)

ip("link", "add", "wlan", "type", "veth", "peer", "name", "lan")
ip("link", "set", "lan", "up")
ip("link", "set", "wlan", "up")
plotjuggler.REOPEN_PERIOD = 0.0
target = {"host": "10.9.0.7", "port": 9870}
sender = plotjuggler.PlotJugglerSender({}, {
    "path": "juggler", "parameters": target, "columns": [{"path": "a.x", "dtype": "float"}]})
sender.say = print
sender.open()                                   # before there is a network
for tick in range(40):
    if tick in (10, 30):
        ip("addr", "add", f"10.9.0.{tick}/24", "dev", "wlan")
    if tick == 20:
        ip("addr", "del", "10.9.0.10/24", "dev", "wlan")
    sender.row(tick, 0.005 * tick, (1.0,))
    if tick in (15, 35):
        print(sender.socket.getsockname()[0])
print(sender.close())
"""


def test_network_with_new_address_is_used_again():
    """As a robot's does that walks from one wireless network into the next: in a network of its own."""
    if subprocess.run(
        ["unshare", "-rn", "ip", "link", "add", "wlan", "type", "veth", "peer", "name", "lan"], capture_output=True
    ).returncode:
        pytest.skip("no network of its own can be had here")
    done = subprocess.run(["unshare", "-rn", sys.executable, "-c", ROAMING], capture_output=True, text=True, timeout=60)
    assert done.stdout.splitlines() == [
        "tickwork: juggler: cannot send to 10.9.0.7 port 9870 (Network is unreachable); the run continues",
        "tickwork: juggler: sending works again; 10 datagrams were lost",
        "10.9.0.10",
        "10.9.0.30",
        "{'datagrams': 20, 'lost': 20, 'trouble': 'Network is unreachable', 'to': '10.9.0.7 port 9870'}",
    ], done.stderr


def test_missing_listener_is_reported_once_and_late_listener_receives_rest():
    listener = Listener()
    listener.socket.close()
    told, signals = [], columns("a.x m")
    sender = PlotJugglerSender({}, here(signals, host="127.0.0.1", port=listener.port))
    sender.say = told.append
    sender.open()
    for tick in range(10):
        sender.row(tick, tick / 200, (float(tick),))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as later:
        later.bind(("127.0.0.1", listener.port))
        for tick in range(10, 20):
            sender.row(tick, tick / 200, (float(tick),))
        result = sender.close()
        assert [strict(later.recv(1 << 16))["a"]["x"] for _ in range(10)] == list(range(10, 20))
    assert told == [
        f"tickwork: juggler: no process listens at 127.0.0.1 port {listener.port}: start the UDP "
        "server in PlotJuggler; the run continues"
    ]
    assert result["datagrams"] == 10 and result["lost"] == 10 and result["trouble"] == "Connection refused"


def test_block_of_diagram_reports_only_lost_listener(listener):
    told = []
    sender = PlotJugglerSender({}, here(columns("a.x m"), host="127.0.0.1", port=listener.port) | {"wanted": False})
    sender.say = told.append
    sender.open()
    for tick in range(200):
        if tick == 100:
            assert len(listener.heard()) == 100
            listener.socket.close()
        sender.row(tick, tick / 200, (1.0,))
    result = sender.close()
    assert told == [
        f"tickwork: juggler: no process listens at 127.0.0.1 port {listener.port} any more: start the "
        "UDP server in PlotJuggler; the run continues"
    ]
    assert 100 <= result["datagrams"] <= 101 and 99 <= result["lost"] <= 100
    sender.open()
    for tick in range(5):
        sender.row(tick, tick / 200, (1.0,))
    assert sender.close()["lost"] and len(told) == 1


def test_unknown_host_is_reported_before_run(tmp_path):
    with pytest.raises(RecorderError, match="juggler cannot start: unknown host 'no-such-host.invalid'"):
        record(plan(tmp_path, here(columns("a.x m"), host="no-such-host.invalid", port=9870)), [])
    assert list(tmp_path.iterdir()) == []


def test_decimation_continues_over_missed_ticks(listener):
    signals = columns("a.x m")
    order = plan(None, here(signals, host=listener.host, port=listener.port, decimation=10))
    record(order, [row(tick, float(tick)) for tick in range(100) if tick not in (30, 31, 57)])
    assert [message["a"]["x"] for message in listener.heard()] == [0, 10, 20, 32, 40, 50, 60, 70, 80, 90]


def test_a_batch_is_a_list_of_messages_each_with_its_timestamp(listener):
    order = plan(None, here(columns("a.x m"), host=listener.host, port=listener.port, batch=20))
    report = record(order, [row(tick, float(tick)) for tick in range(70)])
    datagrams = listener.heard()
    assert [message["timestamp"] for datagram in datagrams for message in datagram] == [
        tick / 200 for tick in range(70)
    ]
    assert max(map(len, datagrams)) == 20 and report["sinks"]["juggler"]["datagrams"] == len(datagrams) >= 4


def test_a_batch_never_outgrows_a_datagram(listener):
    wide = columns(*(f"left/{'b' * 40}{index}.x m" for index in range(400)))
    order = plan(None, here(wide, host=listener.host, port=listener.port, batch=100))
    report = record(order, [row(tick, *range(400)) for tick in range(30)])
    datagrams = listener.heard()
    assert report["sinks"]["juggler"]["lost"] == 0 and [
        message["timestamp"] for datagram in datagrams for message in datagram
    ] == [tick / 200 for tick in range(30)]
