"""Tables of metabolic carts: their formats, files that grow, and streams."""

import math
import os
import pty
import socket
import time
import tty

import pytest

from runtime.experiments.optimisation.cart import Clock, Table, number, open_cart
from runtime.experiments.optimisation.metabolic import power
from runtime.host.errors import BadInput

WALKING = power(1.2 / 60, 1.0 / 60)  # W


def samples(text):
    table = Table()
    return [sample for line in text.splitlines() if (sample := table.sample(line)) is not None]


FORMATS = {
    "tabs": "time (s)\tVO2 (mL/min)\tVCO2 (mL/min)\n61.5\t1200\t1000\n",
    "semicolons and decimal commas": "Time;VO2 [L/min];VCO2 [L/min]\n61,5;1,2;1,0\n",
    "commas, other columns, minutes": 'Phase,"Time (min)","V\'O2 (mL/min)",RQ,"V\'CO2 (mL/min)"\n'
    "walk,1.025,1200,.83,1000\n",
    "title and row of units": "Subject S03\nt\tVO2\tVCO2\nhh:mm:ss\tmL/min\tmL/min\n0:01:01.5\t1200\t1000\n",
    "row of other units": "t\tVO2\tVCO2\nmin\tL/min\tL/min\n1.025\t1.2\t1.0\n",
    "spaces": "time (s)  VO2 (mL/s)  VCO2 (mL/s)\n61.5 20 16.6666666667\n",
    "without header": "61.5 1200 1000\n",
}


@pytest.mark.parametrize("name", FORMATS)
def test_formats_of_carts_are_read(name):
    assert samples(FORMATS[name]) == [(pytest.approx(61.5), pytest.approx(WALKING))]


def test_power_is_read_with_and_without_times():
    assert samples("W\n406.5\n") == [(pytest.approx(math.nan, nan_ok=True), 406.5)]
    assert samples("3.0\t406.5") == [(3.0, 406.5)]
    assert samples("t\tEE (kcal/min)\n3\t5\n") == [(3.0, pytest.approx(348.67, abs=0.01))]


def test_lines_without_valid_sample_are_rejected():
    table = Table()
    for line in ("time\tW", "1\tnan", "2\t", "3\tinf", "4\t-5", "5\t65535", "6", "x\t400", "7\t400"):
        last = table.sample(line)
    assert (last, table.rejected) == ((7.0, 400.0), 7)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (
            "time\tVO2 (mL/min/kg)\tVCO2",
            "column 'VO2 (mL/min/kg)' (oxygen): unknown unit 'mL/min/kg'; expected one of ml/min, ",
        ),
        ("time\tVO2", "has neither a power nor both VO2 and VCO2"),
        ("1\t2\t3\t4", "4 columns without a header: expected a first line with names and units"),
    ],
)
def test_table_without_known_columns_is_reported(text, reason):
    with pytest.raises(BadInput) as error:
        Table().sample(text)
    assert reason in str(error.value)


def test_times_of_clocks_are_numbers():
    assert [number(text) for text in ("1:02:03.5", "62:03", "7", "1e2")] == [3723.5, 3723.0, 7.0, 100.0]
    assert math.isnan(number("walk")) and math.isnan(number(""))


def test_offset_of_clocks_is_that_of_least_delay():
    clock = Clock()
    assert clock.here(10.0, 112.0) == 112.0  # 2 s late
    assert clock.here(13.0, 113.5) == 113.5
    assert clock.here(16.0, 120.0) == 116.5  # written in one block, later than measured
    assert clock.here(math.nan, 121.0) == 121.0
    assert clock.here(0.5, 300.0) == 300.0  # the cart was started again
    assert clock.here(5.0, 303.0) == 303.0 and clock.here(8.0, 307.0) == 306.0


def test_file_that_grows_gives_only_new_whole_lines(tmp_path):
    path = tmp_path / "metabolic.tsv"
    cart = open_cart(str(path))
    assert cart.take(0.0) == []  # no file yet: the cart is started later
    path.write_text("time\tW\n1\t300\n")
    assert cart.take(1.0) == [(1.0, 300.0)]
    with path.open("a") as file:
        file.write("2\t310\n3\t3")
    assert cart.take(2.5) == [(2.0, 310.0)]
    with path.open("a") as file:
        file.write("20\n")
    assert cart.take(3.0) == [(3.0, 320.0)]


def test_samples_before_run_are_ignored(tmp_path):
    path = tmp_path / "metabolic.tsv"
    path.write_text("time\tW\n1\t300\n")
    cart = open_cart(str(path))
    assert cart.take(50.0) == []
    with path.open("a") as file:
        file.write("2\t310\n")
    assert cart.take(51.0) == [(51.0, 310.0)]


def test_file_that_is_written_again_gives_its_new_lines_only(tmp_path):
    path, new = tmp_path / "metabolic.tsv", tmp_path / "new.tsv"
    path.write_text("time\tW\n")
    cart = open_cart(str(path))
    assert cart.take(0.0) == []
    for count in (1, 2, 3):
        new.write_text("time\tW\n" + "".join(f"{line}\t{300 + line}\n" for line in range(count)))
        os.replace(new, path)
        assert cart.take(float(count)) == [(pytest.approx(count), 300.0 + count - 1)]
    path.write_text("time\tW\n")  # truncated: the same lines follow again
    assert cart.take(4.0) == []
    path.write_text("time\tW\n0\t300\n1\t301\n2\t302\n3\t303\n")
    assert cart.take(4.0) == [(4.0, 303.0)]


def test_pipe_and_serial_line_are_read(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    cart = open_cart(str(pipe))
    assert cart.take(0.0) == []
    writer = os.open(pipe, os.O_WRONLY)
    os.write(writer, b"400\n410\n")
    assert cart.take(1.0) == [(1.0, 400.0), (1.0, 410.0)]
    os.close(writer)
    assert cart.take(2.0) == []

    master, slave = pty.openpty()
    tty.setraw(master)
    cart = open_cart(f"serial:{os.ttyname(slave)}@19200")
    assert cart.take(0.0) == []
    os.write(master, b"1200\t400\r\n")
    assert cart.take(1.0) == [(1.0, 400.0)]
    os.close(master)
    os.close(slave)
    assert cart.take(2.0) == []  # unplugged


def gas_outlet(name, labels, source=None):
    """An outlet of a metabolic cart. source : source_id, by default the name"""
    pylsl = pytest.importorskip("pylsl")
    info = pylsl.StreamInfo(name, "Gas", len(labels), 0.0, "double64", name if source is None else source)
    channels = info.desc().append_child("channels")
    for label in labels:
        channel = channels.append_child("channel")
        channel.append_child_value("label", label)
        channel.append_child_value("unit", "mL/min")
    return pylsl.StreamOutlet(info)


def test_a_stream_of_the_lab_streaming_layer_is_a_table():
    name = f"cart {os.getpid()}"
    outlet = gas_outlet(name, ("VO2", "VCO2"))
    cart = open_cart(f"lsl:{name}")
    assert cart.take(0.0) == []
    outlet.push_sample([1000.0, 900.0])
    deadline, taken = time.monotonic() + 5.0, []
    while not taken and time.monotonic() < deadline:
        taken = cart.take(1.0)
        time.sleep(0.01)
    [(at, rate)] = taken
    assert at == 1.0 and rate == pytest.approx(power(1.0 / 60.0, 0.9 / 60.0))
    with pytest.raises(BadInput, match="--cost lsl:no cart: 0 streams have this name, expected 1"):
        open_cart("lsl:no cart")


def test_a_stream_that_is_lost_permanently_gives_no_samples():
    name = f"lost cart {os.getpid()}"
    outlet = gas_outlet(name, ("VO2", "VCO2"), source="")
    cart = open_cart(f"lsl:{name}")
    del outlet
    deadline = time.monotonic() + 2.0
    while time.monotonic() < deadline:
        assert cart.take(1.0) == []
        time.sleep(0.05)


@pytest.mark.soak  # liblsl takes seconds to find a restarted outlet
@pytest.mark.paced
def test_a_cart_that_restarts_with_its_columns_exchanged_is_not_read():
    name = f"restarted cart {os.getpid()}"
    outlet = gas_outlet(name, ("VO2", "VCO2"))
    cart = open_cart(f"lsl:{name}")

    def sent(sample):
        taken = []
        for _ in range(100):
            outlet.push_sample(sample)
            taken += cart.take(1.0)
            time.sleep(0.1)
            if taken and sample[0] == 1000.0:
                break
        return {round(value, 6) for _, value in taken}

    expected = {round(power(1.0 / 60.0, 0.9 / 60.0), 6)}
    assert sent([1000.0, 900.0]) == expected
    for labels, sample, values in (
        (("VCO2", "VO2"), [900.0, 999.0], set()),
        (("VO2", "VCO2"), [1000.0, 900.0], expected),
    ):
        outlet = None
        time.sleep(0.2)
        outlet = gas_outlet(name, labels)
        assert sent(sample) == values


def test_tcp_stream_is_connected_again_after_loss(monkeypatch):
    monkeypatch.setattr("runtime.experiments.optimisation.cart.RECONNECT_PERIOD", 0.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        cart = open_cart(f"tcp:127.0.0.1:{port}")
        first, _ = server.accept()
        assert cart.take(0.0) == []
        first.sendall(b"400\n")
        assert cart.take(1.0) == [(1.0, 400.0)]
        first.close()
        assert cart.take(2.0) == [] and cart.take(2.0) == []
        second, _ = server.accept()
        second.sendall(b"500\n")
        assert cart.take(3.0) == [(3.0, 500.0)]
        second.close()
    with pytest.raises(BadInput, match="cannot connect: Connection refused"):
        open_cart(f"tcp:127.0.0.1:{port}")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("tcp:5000", "--cost tcp:5000: expected tcp:HOST:PORT"),
        ("serial:/dev/ttyUSB77", "--cost serial:/dev/ttyUSB77: No such file or directory"),
        ("serial:/dev/null@fast", "expected serial:DEVICE@BAUD"),
        ("no/such/folder/a.tsv", "there is no folder no/such/folder"),
        (".", "--cost . is a folder: pass the file that the cart writes"),
    ],
)
def test_source_that_cannot_be_opened_is_reported(text, reason):
    with pytest.raises(BadInput) as error:
        open_cart(text)
    assert reason in str(error.value)
