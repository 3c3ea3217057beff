"""Rig files: their content, and their mistakes, which are reported together."""

import pytest

from runtime.robot.rig.errors import RigError
from runtime.robot.rig.file import read

GOOD = """\
[bus.legs]
interface = "socketcan"
channel = "can0"
bitrate = 500_000

[bus.arms]
interface = "slcan"
channel = "/dev/ttyACM0"

[device."left/knee"]
can_id = 3
invert = true
"""


@pytest.fixture
def written(tmp_path):
    def written(text, name="lab.toml"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return written


def troubles(path):
    """(code, message, hint) of everything that is wrong."""
    with pytest.raises(RigError) as caught:
        read(path)
    for trouble, line in zip(caught.value.problems, str(caught.value).split(f"{path}: ")[1:]):
        assert line.startswith(f"error {trouble.code} ") and trouble.message in line
    return [(trouble.code, trouble.message, trouble.hint) for trouble in caught.value.problems]


def test_a_rig_is_read(written):
    path = written(GOOD)
    rig = read(path)
    assert (rig.path, rig.text) == (path, GOOD)
    legs, arms = rig.buses["legs"], rig.buses["arms"]
    assert (legs.name, legs.interface, legs.channel, legs.bitrate, legs.fd) == (
        "legs",
        "socketcan",
        "can0",
        500_000,
        False,
    )
    assert (arms.interface, arms.channel, arms.bitrate) == ("slcan", "/dev/ttyACM0", 1_000_000)
    assert rig.devices == {"left/knee": {"can_id": 3, "invert": True}}


def test_a_rig_may_be_empty_and_may_have_windows_line_ends(written):
    assert read(written("")).buses == {}
    assert read(written(GOOD.replace("\n", "\r\n"))).text == GOOD


@pytest.mark.parametrize(
    "text, message, hint",
    [
        (
            '[buss.legs]\nchannel = "can0"',
            "[buss]: unknown table: a rig has [bus], [device] and [battery]",
            "did you mean 'bus'?",
        ),
        (
            '[motors."left/knee"]',
            "[motors]: unknown table: a rig has [bus], [device] and [battery]",
            'write [bus.NAME], [device."PATH"] or [battery]',
        ),
        ('bus = "can0"', "bus = 'can0': expected a table", "write [bus.NAME]"),
        (
            '[bus]\nchannel = "can0"',
            "[bus] channel = 'can0': expected a table",
            "write [bus.NAME], followed by its keys",
        ),
        (
            "[device]\ncan_id = 3",
            "[device] can_id = 3: expected a table",
            'write [device."PATH"], followed by its keys',
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrat = 1',
            "[bus.legs] bitrat: unknown key",
            "did you mean 'bitrate'?",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nzzz = 1',
            "[bus.legs] zzz: unknown key",
            "it has interface, channel, bitrate, fd, data_bitrate, peer, key, options",
        ),
        (
            '[bus.legs]\ninterfase = "socketcan"\nchannel = "can0"',
            "[bus.legs] interfase: unknown key",
            "did you mean 'interface'?",
        ),
        ('[bus.legs]\nchannel = "can0"', "[bus.legs] interface is missing", 'write interface = "socketcan"'),
        ('[bus.legs]\ninterface = "socketcan"', "[bus.legs] channel is missing", 'write channel = "can0"'),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = 0',
            "[bus.legs] channel = 0: expected text",
            'write channel = "can0"',
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = ""',
            "[bus.legs] channel = '': expected text",
            'write channel = "can0"',
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = "1M"',
            "[bus.legs] bitrate = '1M': expected a whole number of bit/s",
            "write bitrate = 1_000_000",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = true',
            "[bus.legs] bitrate = True: expected a whole number of bit/s",
            "write bitrate = 1_000_000",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = 1e6',
            "[bus.legs] bitrate = 1000000.0: expected a whole number of bit/s",
            "write bitrate = 1_000_000",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nbitrate = 1000',
            "[bus.legs] bitrate = 1000: outside the range of CAN, 10000 to 1000000 bit/s",
            "write bitrate = 1_000_000",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nfd = 1',
            "[bus.legs] fd = 1: expected true or false",
            "write fd = true",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\ndata_bitrate = 5_000_000',
            "[bus.legs] data_bitrate: only frames of CAN FD have a data phase",
            "write fd = true, or remove data_bitrate",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "can0"\nfd = true\ndata_bitrate = 500_000',
            "[bus.legs] data_bitrate = 500000: outside the range of CAN FD on this bus, from its bitrate, 1000000, to "
            "8000000 bit/s",
            "write data_bitrate = 5_000_000",
        ),
        (
            '[bus.legs]\ninterface = "socketcan"\nchannel = "/dev/ttyACM0"',
            "[bus.legs] channel = '/dev/ttyACM0': not a valid name of a network interface",
            'write channel = "can0"; `ip link` lists the interfaces of this machine',
        ),
        (
            '[bus.legs]\ninterface = "soketcan"\nchannel = "can0"',
            "[bus.legs] interface = 'soketcan': python-can has no such interface",
            "did you mean 'socketcan'?",
        ),
    ],
)
def test_invalid_entry_is_reported_with_correction(written, text, message, hint):
    assert troubles(written(text)) == [("TW102", message, hint)]


def test_two_buses_cannot_share_an_interface(written):
    text = "".join(f'[bus.{name}]\ninterface = "socketcan"\nchannel = "can0"\n' for name in ("legs", "arms"))
    [(code, message, hint)] = troubles(written(text))
    assert (code, message) == ("TW102", "[bus.arms] channel = 'can0' is also used by [bus.legs]") and hint.startswith(
        "use a separate interface"
    )


def test_all_mistakes_are_reported_together(written):
    text = '[bus.legs]\ninterface = "socketcan"\nbitrate = 1\n[bus.arms]\nchanel = "can1"\n[moter."left/knee"]\n'
    assert [message for _, message, _ in troubles(written(text))] == [
        "[moter]: unknown table: a rig has [bus], [device] and [battery]",
        "[bus.legs] channel is missing",
        "[bus.arms] chanel: unknown key",
        "[bus.arms] interface is missing",
    ]


def test_invalid_toml_is_reported_with_its_line(written):
    [(code, message, hint)] = troubles(written("[bus.legs]\nchannel = can0\n"))
    assert (
        code == "TW101" and message.startswith("invalid TOML: ") and "line 2" in message and "quote text with" in hint
    )
    [(_, message, _)] = troubles(written("[bus.legs]\nfd = true\nfd = false\n"))
    assert "line 3" in message
    [(code, message, _)] = troubles(written("a = " + "[" * 5000))
    assert code == "TW101" and message.startswith("invalid TOML: ")


def test_unreadable_file_is_reported(written, tmp_path):
    path = written(GOOD)
    assert troubles(tmp_path / "lap.toml") == [("TW101", "no such file", "did you mean 'lab.toml'?")]
    assert troubles(tmp_path / "nowhere" / "lab.toml") == [("TW101", "no such file", "")]
    assert troubles(path.parent)[0][1] == "is a folder"
    problem = ("TW101", "not UTF-8 text", "save the file in the encoding UTF-8")
    assert troubles(written(b"\xff\xfe\x00", "utf16.toml")) == [problem]


def test_byte_order_mark_and_line_ends_of_windows_are_read(written):
    assert read(written(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())).buses == read(written(GOOD)).buses
