"""Rerun: what a viewer finds in its file, and that neither a viewer nor a disk that has gone stops a run."""

import importlib.util
import json
import math
import os
import re
import resource
import signal
import socket
import subprocess
import sys
import threading
import urllib.request

import numpy as np
import pytest

import runtime
from cext.memory.shared_state import RECORD_EVENT, SharedState
from runtime.host.errors import OK, BadInput
from runtime.host.live.running import shared_state_of
from runtime.record.recorder import RecorderError, RecorderProcess
from runtime.record.recorder.rerun import viewer
from runtime.record.recorder.rerun.scene import Scene
from runtime.record.recorder.rerun.target import Target, parse
from tests.runtime.record.recorder.running import CSV, columns, plan, record, row, sink
from tests.runtime.runs import KNEE_EXO, descendant, environment, finished, knee, started, writer_of
from tests.runtime.terminals import patient

RERUN = "runtime.record.recorder.services.rerun:RerunSender"
needs_rerun = pytest.mark.skipif(importlib.util.find_spec("rerun") is None, reason="needs rerun-sdk")
TORQUE = "/left/N-m"
LEG = (
    "left/knee.position rad",
    "left/knee.torque N·m",
    "left/knee.fault 1 int",
    "left/shank_imu.quaternion[0] 1",
    "left/shank_imu.quaternion[1] 1",
    "left/shank_imu.quaternion[2] 1",
    "left/shank_imu.quaternion[3] 1",
    "clock.t s",
)


def signals(*texts):
    return [{"path": column["path"], "unit": column["unit"], "dtype": column["dtype"]} for column in columns(*texts)]


def free_ports():
    """Two, which are not the same."""
    with socket.create_server(("", 0)) as first, socket.create_server(("", 0)) as second:
        return first.getsockname()[1], second.getsockname()[1]


def free_port():
    return free_ports()[0]


def program():
    import rerun_cli

    return os.path.join(os.path.dirname(rerun_cli.__file__), "rerun")


def verify(path):
    done = subprocess.run([program(), "rrd", "verify", str(path)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr


def vectors(path):
    """{entity: (ticks, (rows, elements) array)} of every entity with scalars and a tick."""
    from rerun.chunk import RrdReader

    found = {}
    for chunk in RrdReader(str(path)).stream():
        batch = chunk.to_record_batch()
        names = batch.schema.names
        scalars = [name for name in names if name.endswith("Scalars:scalars")]
        if scalars and "tick" in names:
            ticks, values = found.setdefault(chunk.entity_path, ([], []))
            ticks += batch["tick"].to_pylist()
            values += batch[scalars[0]].to_pylist()
    return found


@pytest.mark.parametrize(
    "text, expected",
    [
        ("", Target("viewer", "127.0.0.1", 9876)),
        ("out/a.rrd", Target("file", "out/a.rrd", 9876)),
        ("serve", Target("serve", "127.0.0.1", 9876)),
        ("serve:0.0.0.0", Target("serve", "0.0.0.0", 9876)),
        ("192.168.1.7", Target("connect", "192.168.1.7", 9876)),
        ("robot:1234", Target("connect", "robot", 1234)),
        ("[::1]:77", Target("connect", "::1", 77)),
        ("rerun+http://lab.local:9876/proxy", Target("connect", "lab.local", 9876)),
    ],
)
def test_destination_is_parsed(text, expected):
    assert parse(text) == expected


@pytest.mark.parametrize("text", ["a b", "host:0", "host:99999", "out/trial.mcap", "::"])
def test_invalid_rerun_targets_are_rejected(text):
    with pytest.raises(BadInput, match="expected no value, a file.rrd, serve"):
        parse(text)


def test_a_plot_a_subsystem_shows_torque_and_position_with_their_limits():
    scene = Scene("robot", signals(*LEG), {"left/knee.torque": (-18.0, 18.0), "left/knee.fault": (0.0, 1.0)})
    position, torque, rest, own = scene.plots
    assert [plot.title for plot in scene.plots] == ["left [rad]", "left [N·m]", "left", "robot [s]"]
    assert (torque.entity, rest.entity, own.entity) == (("left", "N-m"), ("left", "values"), ("robot", "s"))
    assert (position.labels, torque.labels, rest.labels[0]) == (["knee.position"], ["knee.torque"], "knee.fault")
    assert (position.shown, torque.shown, rest.shown, own.shown) == ([True], [True], 5 * [False], [True])
    assert torque.limits == [("knee.torque ≤ 18 N·m", 18.0), ("knee.torque ≥ -18 N·m", -18.0)] != position.limits == []


def test_equal_limits_are_one_line_and_a_torque_has_the_colour_of_its_position():
    names = ("hip", "knee", "ankle")
    robot = signals(
        "clock.t s",
        "left/imu.temperature °C",
        *(f"left/{name}.{port}" for name in names for port in ("position rad", "torque N·m")),
    )
    _, position, torque, own = Scene(
        "robot", robot, {f"left/{name}.torque": (-limit, limit) for name, limit in zip(names, (18.0, 18.0, 9.0))}
    ).plots
    assert torque.limits == [
        ("hip, knee.torque ≤ 18 N·m", 18.0),
        ("hip, knee.torque ≥ -18 N·m", -18.0),
        ("ankle.torque ≤ 9 N·m", 9.0),
        ("ankle.torque ≥ -9 N·m", -9.0),
    ]
    assert own.title == "robot [s]", "what has actuators comes first"
    assert torque.labels == [f"{name}.torque" for name in names] and len(set(torque.colours)) == 3
    assert torque.colours == position.colours and torque.colours[0] == (0, 114, 178)


@needs_rerun
def test_a_sensor_moves_with_its_segment():
    """Of a leg whose hip is bent by a right angle forward and whose knee by one back: thigh level, shank upright, foot
    level.
    """
    from runtime.record.recorder.rerun.stream import HIP_HEIGHT, HIP_WIDTH, LENGTHS, SENSOR_OFFSET, place_of

    parts = [f"left/{name}_imu.quaternion[{number}] 1" for name in ("thigh", "shank", "foot") for number in range(4)]
    scene = Scene(
        "robot",
        signals(
            "left/hip.position rad",
            "left/knee.position rad",
            *parts,
            *(f"trunk/imu.quaternion[{n}] 1" for n in range(4)),
        ),
        {},
    )
    values = np.array([[math.pi / 2, math.pi / 2, *([0.0] * 16)], [0.0] * 18])
    thigh, shank, foot, trunk = (place_of(sensor, scene, values) for sensor in scene.sensors)
    y, knee = HIP_WIDTH / 2 + SENSOR_OFFSET, LENGTHS["thigh"]
    assert thigh == pytest.approx(np.array([[knee / 2, y, HIP_HEIGHT], [0.0, y, HIP_HEIGHT - knee / 2]]), abs=1e-12)
    assert shank == pytest.approx(
        np.array([[knee, y, HIP_HEIGHT - LENGTHS["shank"] / 2], [0.0, y, HIP_HEIGHT - knee - LENGTHS["shank"] / 2]]),
        abs=1e-12,
    )
    assert foot[0] == pytest.approx([knee + LENGTHS["foot"] / 2, y, HIP_HEIGHT - LENGTHS["shank"]], abs=1e-12)
    assert trunk[0] == pytest.approx(trunk[1]) and trunk[0][0] < 0.0


def test_plotted_signals_are_first_in_legend():
    plots = Scene(
        "robot", signals("left/a.x rad", "left/b.y s", "left/knee.position rad", "left/knee.torque 1"), {}
    ).plots
    angles = plots[0]
    assert (angles.labels, angles.columns, angles.shown) == (["knee.position", "a.x"], [2, 0], [True, False])
    assert [plot.shown for plot in plots[1:]] == [[False], [True]]


def test_a_started_viewer_can_be_terminated(monkeypatch):
    """The process that starts it ignores what ends others."""
    monkeypatch.setattr(viewer, "executable", lambda: "sleep")
    before = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        for number in before:
            started_one = viewer.start("60", mortal=False)
            started_one.send_signal(number)
            assert started_one.wait(10) == -number
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def test_leg_is_identified_by_joint_and_sensor_names():
    scene = Scene("robot", signals(*LEG), {"left/knee.torque": (-18.0, 18.0)})
    [limb], [sensor] = scene.limbs, scene.sensors
    assert (limb.side, set(limb.joints)) == ("left", {"knee"}) and (
        limb.joints["knee"].position,
        limb.joints["knee"].torque,
    ) == (0, 1)
    assert limb.joints["knee"].limit == 18.0 and (sensor.side, sensor.segment, sensor.columns) == (
        "left",
        "shank",
        (3, 4, 5, 6),
    )
    assert Scene("robot", signals("a.x m"), {}).limbs == []


@needs_rerun
def test_every_row_of_a_run_is_in_the_file_in_order_and_to_the_bit(tmp_path):
    odd = [0.1, -0.0, 5e-324, math.inf, math.nan, 1 / 3]
    rows = [(tick, *(odd[(tick + place) % 6] for place in range(len(LEG)))) for tick in range(700) if tick != 300]
    target = sink(RERUN, "rerun", columns(*LEG), target=str(tmp_path / "live.rrd"), port=9876, web_port=9090)
    report = record(plan(None, target, limits={"left/knee.torque": [-18.0, 18.0]}), [row(*values) for values in rows])
    assert report["sinks"]["rerun"] == {"rows": 699, "lost": 0} and report["problems"] == []
    verify(tmp_path / "live.rrd")
    found = vectors(tmp_path / "live.rrd")
    for entity, first, end in (("/left/rad", 1, 2), (TORQUE, 2, 3), ("/left/values", 3, 8), ("/bench/s", 8, 9)):
        ticks, values = found[entity]
        assert ticks == [values[0] for values in rows]
        assert np.array(values).tobytes() == np.array([values[first:end] for values in rows]).tobytes()
    assert found[f"{TORQUE}/limits"][1][0] == [18.0, -18.0] and found[f"{TORQUE}/limits"][0][0] == 0


@needs_rerun
def test_an_exported_file_has_every_sample(command_line, tmp_path):
    rows = [(tick, *(math.sin(tick + place) for place in range(len(LEG)))) for tick in range(500)]
    record(plan(tmp_path, sink(CSV, "csv", columns(*LEG)), stem="trial"), [row(*values) for values in rows])
    code, out, err = command_line("convert", tmp_path / "trial.mcap", "--to", "rrd")
    assert (code, err) == (OK, "")
    verify(out.strip())
    trial = runtime.load(tmp_path / "trial.mcap")
    ticks, values = vectors(out.strip())["/left/values"]
    expected = np.ascontiguousarray(trial.rows[:, 2:7])
    assert ticks == trial.tick.tolist() and np.array(values).tobytes() == expected.tobytes()


@needs_rerun
def test_times_are_those_of_the_ticks_to_the_nanosecond_and_events_stay_when_they_were_at_another_rate(
    command_line, tmp_path
):
    from rerun.chunk import RrdReader

    mark = RECORD_EVENT, json.dumps({"event": "mark", "number": 1, "tick": 201, "by": "keys"}).encode()
    record(
        plan(tmp_path, sink(CSV, "csv", columns("a.x m")), stem="trial"),
        [*(row(tick, 0.1 * tick) for tick in range(400)), mark],
    )
    for rate, words in ((200, ()), (50, ("--rate", "50"))):
        code, out, err = command_line(
            "convert", tmp_path / "trial.mcap", "--to", "rrd", "-o", tmp_path / str(rate), *words
        )
        assert (code, err) == (OK, "")
        times, marks = [], []
        for chunk in RrdReader(out.strip()).stream():
            batch = chunk.to_record_batch()
            if "time" in batch.schema.names:
                (marks if chunk.entity_path == "/events" else times).extend(batch["time"].cast("int64").to_pylist())
        assert times == [round(tick * 1e9 / rate) for tick in range(2 * rate)] and marks[0] == 1_005_000_000


def test_a_subsystem_named_like_the_diagram_shares_its_plot():
    [plot] = Scene("robot", signals("a.x m", "robot/b.y m"), {}).plots
    assert (plot.title, plot.entity, plot.labels, plot.columns) == ("robot [m]", ("robot", "m"), ["a.x", "b.y"], [0, 1])


@needs_rerun
def test_viewer_opens_mcap_recording(tmp_path):
    """Which it reads by the index of chunks alone."""
    from rerun.chunk import RrdReader

    record(
        plan(tmp_path, sink(CSV, "csv", columns(*LEG)), stem="trial"),
        [row(tick, *[float(tick)] * len(LEG)) for tick in range(2000)],
    )
    for words in (["check", "trial.mcap"], ["convert", "trial.mcap", "-o", "trial.rrd"]):
        done = subprocess.run([program(), "mcap", *words], cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stdout + done.stderr
    rows = {}
    for chunk in RrdReader(str(tmp_path / "trial.rrd")).stream():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.to_record_batch().num_rows
    assert rows["/left"] == rows["/bench"] == rows["/tickwork/tick"] == 2000 + 1  # and the schema


@pytest.mark.soak
@needs_rerun
def test_in_virtual_time_the_run_waits_for_slow_viewers(tmp_path):
    process = finished(KNEE_EXO, "--fast", "--duration", "60", "--no-record", "--rerun", "walk.rrd", cwd=tmp_path)
    assert process.returncode == OK, process.stderr
    assert "walk.rrd  (12000 ticks of 49 signals, for Rerun)" in process.stdout
    ticks, _ = vectors(tmp_path / "walk.rrd")["/left/rad"]
    assert ticks == list(range(12000))
    again = finished(KNEE_EXO, "--fast", "--duration", "1", "--no-record", "--rerun", "walk.rrd", cwd=tmp_path)
    assert "walk-2.rrd  (200 ticks" in again.stdout  # nothing is overwritten


@needs_rerun
def test_server_is_announced_and_listens_on_loopback_until_run_ends(tmp_path):
    port, web = free_ports()
    path = knee(tmp_path)
    path.write_text(
        f"{path.read_text()}    from blocks.sinks import Rerun\n    Rerun(target='serve', port={port}, "
        f"web_port={web})\n"
    )
    run = started(path, "--no-record", cwd=tmp_path)
    assert run.stderr.readline() == (
        f"tickwork: Rerun in a browser: http://127.0.0.1:{web}/?url=rerun%2Bhttp://127.0.0.1:{port}/proxy\n"
    )
    assert {listening(port), listening(web)} == {"0100007F"}
    patient(lambda: (shared := shared_state_of(run.pid)) and shared.statistics()["ticks"] > 0)
    run.send_signal(signal.SIGTERM)
    run.communicate(timeout=60)
    assert run.returncode == 143
    patient(lambda: listening(port) is None and listening(web) is None)


@needs_rerun
def test_only_the_shared_state_of_the_server_may_connect_to_it():
    """Which it asks the server before each connection (CORS); on any loopback address it is as elsewhere."""
    port, web = free_ports()
    server, _ = viewer.serve("127.0.0.2", port, web)
    try:

        def allowed(origin):
            request = urllib.request.Request(
                f"http://127.0.0.2:{port}/rerun.sdk_comms.v1alpha1.MessageProxyService/ReadMessages",
                method="OPTIONS",
                headers={
                    "Origin": origin,
                    "Access-Control-Request-Method": "POST",
                    "Access-Control-Request-Headers": "content-type,x-grpc-web",
                },
            )
            return urllib.request.urlopen(request, timeout=10).headers.get("access-control-allow-origin")

        for shared in (f"http://127.0.0.2:{web}", f"http://{socket.gethostname()}:{web}"):
            assert allowed(shared) == shared
        assert allowed("http://elsewhere.example") is None
    finally:
        server.kill()
        server.wait()


def test_server_on_all_addresses_is_announced_with_reachable_one():
    assert viewer.reached_at("127.0.0.1") == "127.0.0.1" and viewer.reached_at("10.1.2.3") == "10.1.2.3"
    assert viewer.reached_at("0.0.0.0") not in ("0.0.0.0", "127.0.0.1")


@pytest.mark.parametrize(
    "speaks, words", [(b"HTTP/1.1 400 Bad Request\r\n", "is not a Rerun viewer"), (b"", "is not a Rerun viewer")]
)
def test_listener_that_is_not_a_viewer_is_reported_before_run(speaks, words):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer():
            line, _ = server.accept()
            with line:
                line.sendall(speaks)
                line.recv(100)

        thread = threading.Thread(target=answer)
        thread.start()
        with pytest.raises(viewer.ViewerFailed, match=words):
            viewer.meet("127.0.0.1", server.getsockname()[1], 0.2)
        thread.join()


def test_server_that_cannot_listen_reports_reason():
    with socket.create_server(("127.0.0.1", 0)) as server:
        with pytest.raises(viewer.ViewerFailed, match="127.0.0.1 port .* is in use"):
            viewer.free("127.0.0.1", server.getsockname()[1])
    with pytest.raises(viewer.ViewerFailed, match="cannot serve on 203.0.113.9: this machine has no such address"):
        viewer.free("203.0.113.9", free_port())


@needs_rerun
def test_missing_display_is_reported_with_alternative(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(viewer.ViewerFailed, match="no display for Rerun's viewer: use --rerun serve for a browser"):
        viewer.viewer(free_port())


def listening(port):
    """The address of a listening socket, in the digits of /proc/net/tcp; None without a listener."""
    for name in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in open(name).read().splitlines()[1:]:
            _, local, _, state, *_ = line.split()
            if state == "0A" and int(local.rpartition(":")[2], 16) == port:
                return local.rpartition(":")[0]
    return None


@pytest.mark.soak
@needs_rerun
def test_killed_viewer_is_reported_and_run_continues(tmp_path):
    port = free_port()
    watching = subprocess.Popen(
        [program(), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        patient(lambda: listening(port))
        run = started(KNEE_EXO, "--duration", "60", "--no-record", "--rerun", f"127.0.0.1:{port}", cwd=tmp_path)
        patient(lambda: (shared := shared_state_of(run.pid)) and shared.statistics()["ticks"] > 200)
        watching.kill()
        line = next(line for line in run.stderr if "rerun stopped" in line)  # a warning may come before it
        assert re.fullmatch(
            r"tickwork recorder: rerun stopped at [\d.]+ s: the viewer on 127\.0\.0\.1 port \d+ .*; "
            r"the run continues\n",
            line,
        ), line
        assert run.poll() is None
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=60)
        assert run.returncode == 130
    finally:
        watching.kill()
        watching.wait()


@needs_rerun
def test_killed_sink_process_is_reported_and_run_continues(tmp_path):
    run = started(KNEE_EXO, "--duration", "60", "--no-record", "--rerun", "a.rrd", cwd=tmp_path)
    feeder = patient(lambda: descendant(run.pid, "runtime.record.recorder.rerun.process"))
    patient(lambda: (tmp_path / "a.rrd").exists() and (tmp_path / "a.rrd").stat().st_size > 100_000)
    os.kill(feeder, signal.SIGKILL)
    assert any("rerun stopped at" in line for line in run.stderr) and run.poll() is None
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=60)
    assert run.returncode == 130


@needs_rerun
@pytest.mark.soak
def test_when_the_writer_is_killed_both_files_are_whole_and_the_second_begins_with_its_part(tmp_path):
    run = started(KNEE_EXO, "--duration", "60", "--record", "out", "--rerun", "a.rrd", cwd=tmp_path)
    patient(lambda: (tmp_path / "a.rrd").exists() and (tmp_path / "a.rrd").stat().st_size > 100_000)
    os.kill(writer_of(run.pid), signal.SIGKILL)
    patient(lambda: (tmp_path / "a-2.rrd").exists() and (tmp_path / "a-2.rrd").stat().st_size > 100_000)
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=60)
    assert run.returncode == 130
    ticks = []
    for name in ("a.rrd", "a-2.rrd"):
        verify(tmp_path / name)
        ticks.append(vectors(tmp_path / name)["/left"][0])
    first, second = sorted((tmp_path / "out").glob("*.mcap"))
    assert runtime.load(second).tick.tolist() == ticks[1]
    whole = runtime.load(first).tick.tolist()
    assert whole[-len(ticks[1]) :] == ticks[1] and ticks[0] == sorted(set(ticks[0])) and set(ticks[0]) <= set(whole)


@needs_rerun
@pytest.mark.soak
def test_a_server_is_restarted_after_the_recorder_was_killed(tmp_path):
    port, web = free_port(), free_port()
    path = knee(tmp_path)
    path.write_text(
        f"{path.read_text()}    from blocks.sinks import Rerun\n    Rerun(target='serve', port={port}, "
        f"web_port={web})\n"
    )
    run = started(path, "--record", "out", cwd=tmp_path)
    assert "Rerun in a browser" in run.stderr.readline()
    patient(lambda: (shared := shared_state_of(run.pid)) and shared.statistics()["ticks"] > 100)
    server = descendant(run.pid, "--serve-web")
    os.kill(writer_of(run.pid), signal.SIGKILL)
    patient(lambda: listening(port) is None)
    patient(lambda: listening(port) == listening(web) == "0100007F")
    patient(lambda: not os.path.exists(f"/proc/{server}"))
    run.send_signal(signal.SIGINT)
    out, err = run.communicate(timeout=60)
    assert run.returncode == 130 and "no record was lost" in err and not re.search(r"rerun( stopped|:)", err), err


@needs_rerun
@pytest.mark.soak
def test_lost_viewer_does_not_stop_the_other_sink(tmp_path):
    port = free_port()
    watching = subprocess.Popen(
        [program(), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    shared = SharedState(1 << 20)
    recorder = RecorderProcess(shared)
    try:
        patient(lambda: listening(port))
        recorder.configure(
            plan(
                tmp_path,
                sink(RERUN, "rerun", columns("a.x m"), target=f"127.0.0.1:{port}", port=port, web_port=9090),
                virtual=False,
            )
        )
    finally:
        watching.kill()
        watching.wait()
    for tick in range(100):
        shared.push(*row(tick, float(tick)))
        if tick == 50:
            patient(lambda: shared.empty)
            os.kill(writer_of(recorder.pid), signal.SIGKILL)
    patient(lambda: (tmp_path / "bench_1_part2.mcap").exists())
    shared.close()
    report = recorder.finish()
    assert any(
        re.match(
            r"rerun( stopped at [\d.]+ s| cannot be continued)?: no Rerun viewer responds on 127\.0\.0\.1", problem
        )
        for problem in report["problems"]
    ), report["problems"]
    assert runtime.load(tmp_path / "bench_1.mcap").tick.tolist() == list(range(100))


@pytest.mark.soak
@needs_rerun
def test_full_disk_is_reported_and_run_continues(tmp_path):
    """The process that feeds Rerun may write no more than 60 kB into its file."""
    run = started(KNEE_EXO, "--duration", "60", "--record", "out", "--rerun", "a.rrd", cwd=tmp_path)
    feeder = patient(lambda: descendant(run.pid, "runtime.record.recorder.rerun.process"))
    patient(lambda: run.poll() is not None or (tmp_path / "out").is_dir() and list((tmp_path / "out").glob("*.mcap")))
    resource.prlimit(feeder, resource.RLIMIT_FSIZE, (60_000, 60_000))
    line = run.stderr.readline()
    assert "a.rrd: check whether the disk is full; the run continues" in line, line
    run.send_signal(signal.SIGINT)
    out, _ = run.communicate(timeout=60)
    assert run.returncode == 130 and "a.rrd  (incomplete)" in out
    [recording] = (tmp_path / "out").glob("*.mcap")
    trial = runtime.load(recording)
    assert trial.complete and len(trial) == trial.end["statistics"]["ticks"]


@needs_rerun
def test_sink_that_cannot_start_is_reported_before_run(tmp_path):
    where = {"port": free_port(), "web_port": 9090}
    with pytest.raises(RecorderError, match="cannot start: no Rerun viewer responds on 127.0.0.1 port"):
        record(plan(None, sink(RERUN, "rerun", columns(*LEG), target=f"127.0.0.1:{where['port']}", **where)), [])
    with pytest.raises(RecorderError, match="No such file or directory"):
        record(plan(None, sink(RERUN, "rerun", columns(*LEG), target=str(tmp_path / "nowhere" / "a.rrd"), **where)), [])


def test_without_the_library_the_extra_is_named(tmp_path):
    path = [entry for entry in sys.path if importlib.util.find_spec("rerun") is None]
    if not path:
        process = subprocess.run(
            [
                sys.executable,
                "-c",
                "import importlib.util, sys\nsys.modules['rerun'], find = None, importlib.util.find_spec\n"
                "importlib.util.find_spec = lambda name: None if name == 'rerun' else find(name)\n"
                f"from runtime.cli.main import main\nsys.exit(main([{str(KNEE_EXO)!r}, '--rerun', '--duration', '1']))",
            ],
            cwd=tmp_path,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=60,
        )
    else:
        process = finished(KNEE_EXO, "--rerun", "--duration", "1", cwd=tmp_path)
    assert process.returncode == 2 and process.stderr == (
        "tickwork: --rerun needs rerun: pip install 'tickwork[rerun]'\n"
    )
