"""Pressure insoles: frames against an oracle in Python, real sockets, and the steps of a walk."""

import binascii
import math
import socket
import struct
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from blocks.sensors import EmulatedInsole, FootContact, Insole
from cext.lines.streams import Streams
from graph import Diagram, DiagramError
from runtime.robot.rig import net_line
from runtime.robot.rig.errors import Refused
from tests.blocks.actuators.wire import MALFORMED, TAKEN, Wired
from tests.blocks.running import by_hand, player, run

NOTED, BYTES, LOST, BACK = 2, 0, 1, 2
ROWS, COLUMNS, LENGTH, WIDTH = 31, 9, 0.27, 0.09
AREA = LENGTH * WIDTH / (ROWS * COLUMNS)


def frame(number, pressures, side=0, rows=ROWS, columns=COLUMNS):
    """pressures : rows x columns, in Pa, NaN where there is no cell"""
    raw = [65535 if math.isnan(p) else round(p / 10.0) for p in np.ravel(pressures)]
    body = struct.pack("<4sBBHBBHI", b"SOLE", 1, side, number, rows, columns, 0, 0) + struct.pack(f"<{len(raw)}H", *raw)
    return body + binascii.crc_hqx(body, 0xFFFF).to_bytes(2, "little")


def summed(pressures):
    """(force, centre, regions) by NumPy."""
    p = np.nan_to_num(pressures) * AREA
    x, y = (np.arange(ROWS) + 0.5) * LENGTH / ROWS, WIDTH / 2 - (np.arange(COLUMNS) + 0.5) * WIDTH / COLUMNS
    ends = [0, *(math.ceil(share * ROWS) for share in (0.3, 0.6, 0.85)), ROWS]
    return (
        p.sum(),
        ((p.sum(axis=1) @ x) / p.sum(), (p.sum(axis=0) @ y) / p.sum()),
        [p[a:b].sum() for a, b in zip(ends, ends[1:])],
    )


def random_pressures(seed):
    source = np.random.default_rng(seed)
    pressures = np.round(source.uniform(0.0, 2e5, (ROWS, COLUMNS)), -1)
    pressures[:4, 0] = pressures[-1, :3] = math.nan
    return pressures


@pytest.fixture(scope="module")
def insole():
    made = {}

    def insole(**parameters):
        key = tuple(parameters.items())
        if key not in made:
            made[key] = Wired(Insole, **parameters)
        return Wired.again(made[key])

    return insole


def hear(wired, data, cut=64, time=0):
    return [wired.hear(BYTES, data[at : at + cut], time=time) for at in range(0, len(data), cut)]


def counts(wired):
    return tuple(int(wired[name]) for name in ("received", "lost", "corrupt"))


@pytest.mark.parametrize("cut", [1, 7, 64])
def test_force_centre_and_regions_are_the_sums_over_the_cells(insole, cut):
    wired, pressures = insole(), random_pressures(1)
    force, centre, regions = summed(pressures)
    assert TAKEN in hear(wired, frame(1, pressures), cut)
    assert (
        wired["force"] == pytest.approx(force)
        and wired["centre"] == pytest.approx(centre)
        and wired["regions"] == pytest.approx(regions)
    )
    assert wired["dead"] == 7.0 and sum(wired["regions"]) == pytest.approx(force)


def test_centre_of_pressure_has_x_forward_and_y_left(insole):
    wired = insole()
    for row, column, centre in (
        (0, 4, (LENGTH / ROWS / 2, 0.0)),
        (ROWS - 1, 0, (LENGTH * (1 - 0.5 / ROWS), WIDTH * 4 / 9)),
    ):
        pressures = np.zeros((ROWS, COLUMNS))
        pressures[row, column] = 5e5
        hear(wired, frame(row, pressures))
        assert wired["centre"] == pytest.approx(centre, abs=1e-12)
    hear(wired, frame(40, np.zeros((ROWS, COLUMNS))))
    assert np.isnan(wired["centre"]).all() and wired["force"] == 0.0


def test_late_and_repeated_frames_give_no_value_and_count_separately(insole):
    """As over Wi-Fi: every tenth frame comes 8 frames later, every seventh twice, across the wrap of the numbers."""
    wired, forces = insole(), []
    arrivals = sorted((step + (8 if step % 10 == 9 else 0), step) for step in range(400))
    arrivals += [(place, step) for place, step in arrivals if step % 7 == 6]
    for place, step in sorted(arrivals):
        data = frame((65300 + step) % 65536, np.full((ROWS, COLUMNS), 1000.0 + 10.0 * step))
        taken = TAKEN in hear(wired, data, time=int(1e7 * place))
        forces.append(wired["force"])
        assert taken == (forces[-1] > max(forces[:-1], default=0.0))
    assert counts(wired) == (361, 39, 0) and wired["late"] == len(arrivals) - 361


def test_a_sender_that_restarts_begins_a_new_sequence(insole):
    """From a number far behind at once, and from a nearer one after a silence; without one, after eight frames."""
    wired, pressures, now = insole(), random_pressures(3), 0.0
    for first, silence, ignored in ((5000, 0.0, 0), (0, 0.0, 0), (2, 0.3, 0), (2, 0.0, 7)):
        now += silence
        before = wired["received"]
        for number in range(first, first + 30):
            now += 0.01
            hear(wired, frame(number, pressures), time=int(1e9 * now))
        assert wired["received"] - before == 30 - ignored and wired["lost"] == 0.0


def test_missing_corrupt_and_foreign_insole_frames_are_counted(insole):
    wired, pressures = insole(), random_pressures(2)
    hear(wired, frame(65535, pressures) + frame(2, pressures))
    assert counts(wired) == (2, 2, 0)
    broken = bytearray(frame(3, pressures))
    broken[100] ^= 4
    assert MALFORMED in hear(wired, bytes(broken)) and counts(wired) == (2, 2, 1)
    assert set(hear(wired, frame(4, pressures, side=1))) == {NOTED} and counts(wired) == (2, 2, 1)
    hear(wired, frame(5, pressures[:30], rows=30) * 2)  # another insole: of another size
    assert counts(wired)[0] == 2 and wired["corrupt"] >= 2.0
    hear(wired, frame(3, pressures) + frame(4, pressures))
    assert wired["received"] >= 3.0 and wired["force"] == pytest.approx(summed(pressures)[0])


@given(
    garbage=st.lists(
        st.one_of(st.binary(max_size=30), st.just(b"SOLE"), st.just(b"SOLE\1\0"), st.just(b"SO")), max_size=6
    ),
    cut=st.integers(1, 64),
)
def test_valid_frame_after_garbage_is_parsed(garbage, cut, insole):
    """Over TCP, as a bridge that was begun in the middle would send; at most one frame later."""
    wired, pressures = insole(transport="tcp"), random_pressures(3)
    good = frame(1, pressures)
    hear(wired, b"".join(garbage) + good + frame(2, pressures) + bytes(len(good)), cut)
    assert wired["received"] == 2.0 and wired["lost"] == 0.0 and wired["force"] == pytest.approx(summed(pressures)[0])


@given(data=st.binary(max_size=3000), cut=st.integers(1, 64))
def test_noise_is_not_decoded_as_a_frame(data, cut, insole):
    wired = insole()
    hear(wired, data, cut)
    assert wired["received"] == 0.0


def robot(**parameters):
    with Diagram("robot", rate=200) as diagram:
        sole = Insole(name="sole", **parameters)
        FootContact(name="steps")(force=sole.force, heel=sole.regions[0])
    return diagram


def walk(ticks, period=1.1):
    """(force, centre) of a foot that rolls from heel to toes in 60 % of a stride, at 1 kHz."""
    phase = np.arange(ticks) / 1000.0 % period / period
    stance = np.clip(phase / 0.6, 0.0, 1.0)
    force = np.where(phase < 0.6, 800.0 * np.sin(math.pi * stance) ** 0.5, 0.0)
    return force, np.stack([0.05 + 0.17 * stance, np.zeros(ticks)], axis=-1)


def test_a_walk_shows_its_force_its_centre_and_its_steps():
    """Five strides on the emulated insole, whose bytes are those of a real one."""
    diagram, (force, centre) = robot(), walk(6000)
    with Diagram("plant", rate=1000) as plant:
        EmulatedInsole.of(diagram["sole"], name="sole")(force=player(force, "N"), centre=player(centre, "m"))
    recording = run(diagram, 1100, plant=plant, substeps=5)
    assert recording.outcome.status == "ok" and recording["sole.lost"][-1] == recording["sole.corrupt"][-1] == 0.0
    assert recording["sole.force"].max() == pytest.approx(800.0, rel=0.01)
    strikes, offs = (recording.time[recording[f"steps.{name}"] > 0.0] for name in ("heel_strike", "toe_off"))
    assert np.diff(strikes) == pytest.approx(np.full(len(strikes) - 1, 1.1), abs=0.011) and len(strikes) >= 4
    assert np.diff(offs) == pytest.approx(np.full(len(offs) - 1, 1.1), abs=0.011)
    assert (offs[0] - strikes[0]) % 1.1 == pytest.approx(0.66, abs=0.03)
    middle = (recording.time > strikes[1] + 0.15) & (recording.time < strikes[1] + 0.5)
    rolled = np.polyfit(recording.time[middle], recording["sole.centre[0]"][middle], 1)[0]
    assert rolled == pytest.approx(0.17 / 0.66, rel=0.02)  # m/s, from heel to toes


def test_the_emulated_insole_preserves_force_and_centre():
    """Near an edge the force alone; 1500 N are the peak of a wearer of 110 kg at 1.9 m/s."""
    unit, wired = Wired(EmulatedInsole), Wired(Insole)
    inside = [(700.0, (0.1, 0.0)), (700.0, (0.15, 0.008)), (1500.0, (0.2, -0.01))]
    edges = [(700.0, (0.0, 0.0)), (700.0, (0.02, 0.03)), (700.0, (0.26, -0.04)), (300.0, (-0.1, 0.1))]
    for number, (force, centre) in enumerate(inside + edges):
        unit["force"], unit["centre"] = force, centre
        unit.arena[0] = number
        while said := unit.say():
            for _, data in said:
                wired.hear(BYTES, data)
        assert wired["force"] == pytest.approx(force, abs=2.0), (force, centre)
        if (force, centre) in inside:
            assert wired["centre"] == pytest.approx(centre, abs=2e-4)
    assert counts(wired) == (7, 0, 0)


def test_foot_contact_has_hysteresis_and_detects_heel_strikes():
    force = np.array([0, 49, 51, 40, 29, 60, 0, 0, 60, 60, 60, 0.0])
    heel = np.array([0, 49, 51, 40, 29, 60, 0, 0, 10, 10, 10, 0.0])
    with Diagram("steps", 100):
        block = FootContact(shortest=0.02)
    outputs = by_hand(block, len(force), force=force, heel=heel)
    assert list(outputs["contact"]) == [0, 0, 1, 1, 0, 0, 0, 0, 1, 1, 1, 0]  # at the sixth it had just left the ground
    assert list(np.flatnonzero(outputs["heel_strike"])) == [2] and list(np.flatnonzero(outputs["toe_off"])) == [4, 11]
    with pytest.raises(DiagramError, match=r"release must be at most press \(50 N\), got 60 N"):
        FootContact(release=60.0)


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def received(opened, insole, wanted, speak):
    """An Insole that has read what `speak` sends, through the thread that reads on a rig."""
    streams = Streams()
    stream = streams.add(opened.fd, "sole")
    net_line.os.close(opened.fd)
    streams.start()
    speaker = threading.Thread(target=speak)
    speaker.start()
    wired, deadline = insole, time.monotonic() + 10.0
    while wired["received"] < wanted and time.monotonic() < deadline:
        for kind, _, data, _ in stream.end.receive():
            wired.hear(kind, data)
        time.sleep(0.002)
    speaker.join()
    streams.end()
    return wired


@pytest.mark.parametrize("transport", ["udp", "tcp"])
def test_insole_frames_are_read_over_a_real_socket(transport, insole):
    """200 frames as a bridge sends them, over loopback: all are there, in order."""
    pressures = [random_pressures(seed) for seed in range(4)]
    kind = socket.SOCK_DGRAM if transport == "udp" else socket.SOCK_STREAM
    port = free_port(kind)
    bridge = socket.socket(socket.AF_INET, kind)
    if transport == "tcp":
        bridge.bind(("127.0.0.1", port))
        bridge.listen()
    line = net_line.open_line("sole", transport, f"127.0.0.1:{port}")

    def speak():
        to = bridge
        if transport == "udp":
            bridge.connect(("127.0.0.1", port))
        else:
            to = bridge.accept()[0]
        for number in range(200):
            to.send(frame(number, pressures[number % 4]))
            time.sleep(0.001)
        to.close()

    wired = received(line, insole(transport=transport), 200, speak)
    bridge.close()
    assert counts(wired) == (200, 0, 0) and wired["force"] == pytest.approx(summed(pressures[3])[0])


def test_invalid_address_is_reported():
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    port = taken.getsockname()[1]
    for transport, address, code, words in (
        ("udp", "5005", "TW102", "expected HOST:PORT"),
        ("udp", f"127.0.0.1:{port}", "TW121", f"UDP port {port} is in use by another program"),
        ("udp", "192.0.2.1:5005", "TW122", "is an address of another machine"),
        ("tcp", f"127.0.0.1:{free_port(socket.SOCK_STREAM)}", "TW128", "Connection refused"),
    ):
        with pytest.raises(Refused) as caught:
            net_line.open_line("left/sole", transport, address)
        assert caught.value.problem.code == code and words in caught.value.problem.message and caught.value.problem.hint
        assert caught.value.problem.message.startswith('[device."left/sole"] address = ')
    taken.close()


def test_regions_are_split_at_configured_bounds():
    block = Insole(regions_at=(0.5,))
    assert block.outputs["regions"].shape == (2,) and block.bounds == (0.0, 16.0)
    with pytest.raises(DiagramError, match="regions_at must be strictly increasing floats between 0.0 and 1.0"):
        Insole(regions_at=(0.6, 0.3))
