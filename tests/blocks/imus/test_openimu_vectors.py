"""Frames of an OpenIMU that its firmware and others made or read, compared with ours.

The vectors stand in the shared room, ../shared/vectors or $TICKWORK_SHARED/vectors, and are no part of the project's
tree.
"""

import math

import numpy as np
import pytest

from blocks.imus import EmulatedOpenImu
from blocks.imus.openimu import frames
from tests.blocks.actuators.wire import EXTENDED, TAKEN, Wired
from tests.blocks.imus.test_openimu import NOTED, identifier, listener  # noqa: F401
from tests.shared import entries

GROUPS = {
    "acceleration": frames.ACCELERATION,
    "angular rate": frames.ANGULAR_RATE,
    "slope": frames.SLOPE,
    "magnetometer": frames.MAGNETIC_FIELD,
}
READ = [entry for entry in entries("openimu_j1939") if entry["direction"] == "imu->host"]
TOLD = [entry for entry in entries("openimu_j1939") if entry["direction"] == "host->imu"]


def outputs(wired, group):
    return {
        frames.ACCELERATION: lambda: wired["accel"],
        frames.ANGULAR_RATE: lambda: np.degrees(wired["gyro"]),
        frames.MAGNETIC_FIELD: lambda: wired["mag"] / 100.0,
        frames.SLOPE: lambda: np.degrees([wired["pitch"], wired["roll"]]),
    }[group]()


def frame_of(entry):
    assert entry["frame"]["is_extended"]
    return entry["frame"]["arbitration_id"] | EXTENDED, bytes.fromhex(entry["frame"]["data_hex"])


@pytest.mark.parametrize("kind", sorted({entry["kind"] for entry in READ}))
def test_frames_of_the_firmware_are_decoded_as_documented(kind, listener):  # noqa: F811  (a fixture)
    """m/s², °/s, ° and G, the same to the last but some digits of a double."""
    group = next(group for name, group in GROUPS.items() if kind.startswith(name))
    for entry in (entry for entry in READ if entry["kind"] == kind):
        name, data = frame_of(entry)
        address = name & 0xFF
        assert name == identifier(group, address)
        wired = listener(max(address, 128))
        # some are from an address that no unit has
        assert wired.hear(name & ~0xFF | max(address, 128), data) in (NOTED, TAKEN)
        key = next(key for key in entry["decoded"] if key.startswith("documented") and "rad/s" not in key)
        assert outputs(wired, group) == pytest.approx(entry["decoded"][key], rel=1e-12, abs=1e-9)


def test_the_angular_rate_has_the_vendors_scale(listener):  # noqa: F811  (a fixture)
    """It reads them with 1/81 °/s and an offset of 400: rest is −4.94 °/s there, and every change of rate is 128/81 =
    1.58 times too large.
    """
    pairs = []
    for entry in (entry for entry in READ if entry["kind"].startswith("angular rate")):
        name, data = frame_of(entry)
        wired = listener(128)
        wired.hear(name & ~0xFF | 128, data)
        theirs = np.array(entry["decoded"]["epicallypowerful open_imu.OpenIMUs._unpack_payload (run)"])
        pairs += zip(np.degrees(wired["gyro"]), theirs)
    ours, theirs = np.array(pairs).T
    slope, offset = np.polyfit(ours, theirs, 1)
    assert slope == pytest.approx(128.0 / 81.0, rel=1e-9) and offset == pytest.approx(
        250.0 * 128.0 / 81.0 - 400.0, abs=1e-6
    )
    assert np.abs(ours - theirs).min() > 1e-3


def test_settings_are_the_frames_that_others_send():
    """But for our address in them."""
    ours = {
        "packet rate divider": lambda i: frames.packet_rate(i["dest"], i["divider"]),
        "packet type (mtlt 2-byte form)": lambda i: frames.packet_type(i["dest"], i["types"], "300RI"),
        "digital filter": lambda i: frames.filters(i["dest"], i["rate_lpf_hz"], i["accel_lpf_hz"]),
        "orientation": lambda i: frames.orientation(i["dest"], i["orientation"]),
        "get request": lambda i: frames.request(i["requested_pgn"], "big"),
        "get request, new format (firmware default SWAP_REQUEST_PGN)": lambda i: frames.request(i["requested_pgn"]),
        "user behavior": lambda i: frames.setting(frames.BEHAVIOUR, i["dest"], i["behavior"] & 255, i["behavior"] >> 8),
    }
    for entry in TOLD:
        name, data = frame_of(entry)
        mine = ours[entry["name"]](entry["inputs"])
        assert (mine[0] & ~0xFF, mine[1]) == (name & ~0xFF & ~EXTENDED, True)
        assert mine[2] in (data, data + b"\0")  # a high byte of the packet type, which is 0


def test_the_emulated_unit_truncates_like_the_firmware():
    """Six bytes: what is behind them are merits and a latency."""
    inputs = {"acceleration": ("accel_m_s2", "accel", 1.0), "angular rate": ("rate_deg_s", "gyro", math.pi / 180.0)}
    units = {model: Wired(EmulatedOpenImu, model=model) for model in ("300RI", "335RI")}
    compared = 0
    for entry in (entry for entry in READ if entry["inputs"] and "raw" not in entry["kind"]):
        wired = Wired.again(units["335RI" if "335RI" in entry["kind"] else "300RI"])
        name, data = frame_of(entry)
        state = wired["state"]
        state[1], state[2] = 0xF, frames.RIGHT_HANDED  # every packet, in the axes that are measured
        wired["state"] = state
        if entry["kind"].startswith("slope"):
            wired["pitch"], wired["roll"] = (entry["inputs"][key] / 57.296 for key in ("pitch_deg", "roll_deg"))
        else:
            key, port, scale = inputs[next(kind for kind in inputs if entry["kind"].startswith(kind))]
            wired[port] = np.array(entry["inputs"][key]) * scale
        sent = {identifier & ~0xFF: data for identifier, data in wired.say()}
        mine, theirs = sent[name & ~0xFF][:6], data[:6]
        size = 3 if entry["kind"].startswith("slope") else 2
        codes = [[int.from_bytes(each[i : i + size], "little") for i in range(0, 6, size)] for each in (mine, theirs)]
        # degrees come here by way of radians: at an edge, a code either way
        exact = size == 2 and "acceleration" in entry["kind"]
        assert codes[0] == codes[1] if exact else max(abs(a - b) for a, b in zip(*codes)) <= 1, entry
        compared += 1
    assert compared == 420
