"""PlotJuggler's layout, and the stream to try the set-up with."""

import re
from xml.etree import ElementTree

import pytest

from runtime.host.errors import OK
from runtime.record.recorder.plotjuggler_layout import layout
from runtime.record.storage.grouping import by_unit
from tests.runtime.runs import KNEE_EXO, Listener, knee, stamps


def names(message, path=""):
    """What PlotJuggler's parser makes of a message: a name for each number."""
    if isinstance(message, dict):
        return [name for key, value in message.items() for name in names(value, f"{path}/{key}")]
    if isinstance(message, list):
        return [name for index, value in enumerate(message) for name in names(value, f"{path}[{index}]")]
    return [path]


def test_every_curve_of_the_layout_is_sent_by_a_run(command_line):
    code, out, err = command_line("plotjuggler", KNEE_EXO)
    assert (code, err) == (OK, "") and out.startswith("knee_exo.xml: 49 signals; in PlotJuggler: File, Load Layout")
    root = ElementTree.parse(command_line.folder / "knee_exo.xml").getroot()
    curves = [curve.get("name") for curve in root.iter("curve")]
    with Listener() as listener:
        code, _, err = command_line(
            KNEE_EXO, "--fast", "--duration", "0.1", "--no-record", "--plotjuggler", listener.address
        )
        assert code == OK, err
        sent = names(listener.wait(1)[0])
    assert set(curves) <= set(sent) and {"/left/knee/position", "/left/knee/torque", "/right/gait_phase/phase"} <= set(
        curves
    )
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["left", "right", "knee_exo"]
    assert root.find("previouslyLoaded_Streamer").get("name") == "UDP Server"
    plugin = root.find("Plugins/plugin")
    assert (plugin.get("ID"), plugin.get("port"), plugin.get("protocol"), plugin.get("timestamp")) == (
        "UDP Server",
        "9870",
        "json",
        "timestamp",
    )


def test_splitter_lists_number_and_shares_of_plots(command_line):
    command_line("plotjuggler", KNEE_EXO, "-o", "mine.xml", "--set", "plot_juggler.port=5556")
    text = (command_line.folder / "mine.xml").read_text()
    assert "port 5556" in text
    for splitter in ElementTree.fromstring(text).iter("DockSplitter"):
        plots = splitter.findall("DockArea/plot")
        shares = [float(share) for share in splitter.get("sizes").split(";")]
        assert len(plots) == len(shares) == int(splitter.get("count")) and abs(sum(shares) - 1.0) < 1e-4


@pytest.mark.parametrize(
    "host, listens",
    [("192.168.1.7", "192.168.1.7"), ("::1", "::1"), ("localhost", "127.0.0.1"), ("laptop.local", "0.0.0.0")],
)
def test_the_listening_address_is_valid_for_plotjuggler(host, listens):
    """It takes no names. And whatever a diagram is called, the file is well-formed."""
    text = layout("left--right & <both>", [], host, 9870)
    assert f"address {listens}, port 9870" in text
    assert ElementTree.fromstring(text).find("Plugins/plugin").get("address") == listens


def test_positions_and_torques_are_first_and_each_unit_has_a_plot():
    signals = [
        {"path": path, "unit": unit, "dtype": dtype}
        for path, unit, dtype in (
            ("left/knee.fault", "1", "int"),
            ("left/knee.torque", "N·m", "float"),
            ("left/knee.position", "rad", "float"),
            ("left/ankle.position", "rad", "float"),
            ("left/gait.phase", "1", "float"),
            ("clock.t", "s", "float"),
        )
    ]
    assert by_unit("robot", signals) == {
        "left": [
            ("left [rad]", ["left/knee.position", "left/ankle.position"]),
            ("left [N·m]", ["left/knee.torque"]),
            ("left", ["left/gait.phase"]),
            ("left, counts and states", ["left/knee.fault"]),
        ],
        "robot": [("robot [s]", ["clock.t"])],
    }


def test_layout_and_dummy_use_the_signals_selected_by_the_block(command_line):
    words = (KNEE_EXO, "--set", "plot_juggler.signals=left, *.torque")
    assert command_line("plotjuggler", *words)[0] == OK
    shown = {
        curve.get("name") for curve in ElementTree.parse(command_line.folder / "knee_exo.xml").getroot().iter("curve")
    }
    with Listener() as listener:
        command_line("plotjuggler", *words, "--dummy", listener.address, "--duration", "0.02")
        sent = names(listener.rest()[0])
    assert (
        shown <= set(sent)
        and {"/left/knee/position", "/right/knee/torque"} <= shown
        and "/right/knee/position" not in sent
    )
    assert "did you mean 'left/knee'" in command_line.refused(
        "plotjuggler", KNEE_EXO, "--set", "plot_juggler.signals=left/kne"
    )


def test_a_diagram_without_the_block_is_shown_whole(command_line, tmp_path):
    assert command_line("plotjuggler", knee(tmp_path))[0] == OK
    assert "/law/torque" in (command_line.folder / "knee.xml").read_text()


def test_dummy_sends_test_waves(command_line):
    with Listener() as listener:
        code, out, err = command_line("plotjuggler", "--dummy", listener.address, "--duration", "0.2")
        messages = listener.rest()
    assert (code, err) == (OK, "") and re.search(r"40 datagrams sent, 0 lost", out)
    assert stamps(messages) == pytest.approx([tick / 200 for tick in range(40)], abs=1e-6)
    assert names(messages[0])[1:] == [
        "/left/knee/position",
        "/left/knee/torque",
        "/right/knee/position",
        "/right/knee/torque",
    ]
    with Listener() as listener:
        command_line("plotjuggler", KNEE_EXO, "--dummy", listener.address, "--duration", "0.05")
        assert len(names(listener.rest()[0])) == 50


def test_missing_listener_is_reported_at_once(command_line):
    with Listener() as listener:
        pass
    code, out, err = command_line("plotjuggler", "--dummy", listener.address, "--duration", "0.05")
    assert (code, err) == (OK, "") and (
        f"--dummy: no process listens at 127.0.0.1 port {listener.address.rpartition(':')[2]}: start the UDP server"
    ) in out


def test_missing_file_or_host_is_reported(command_line):
    assert command_line.refused("plotjuggler").startswith("no diagram file given: pass one")
    assert command_line.refused("plotjuggler", "--dummy", "no-such-host.invalid:9870").startswith(
        "--dummy: unknown host"
    )
