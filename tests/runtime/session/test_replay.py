"""Replay: a recorded run once more, bit for bit, or the first place where it is not."""

import hashlib
import io
import json
import os
import signal
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest
from mcap.records import Attachment, Channel, Message
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from runtime.host.errors import BAD_INPUT, CHECK_FAILED, FAULT, OK, BadInput
from runtime.record.analysis.trial import Trial
from runtime.record.storage.records import LIBRARY as LIBRARY_NAME
from runtime.robot.loading.file import load
from tests.runtime.record.recorder.test_mcap import chunks
from tests.runtime.robot.guardian.bus import Bus
from tests.runtime.runs import KNEE_EXO, finished, knee, started, write, writer_of
from tests.runtime.terminals import patient
from tests.soaking import soaked

ROOT = Path(__file__).parents[3]

# A knee whose law has state, knows the clock, and does what `law` says.
LAW = """
import os
import random
import time
from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from graph import Block, Diagram, Input, Output

class Law(Block):
    position, velocity = Input("rad"), Input("rad/s")
    torque = Output("N·m")

    def reset(self):
        self.sum = 0.0

    def step(self, position, velocity, t, tick, dt):
        self.sum += dt
        {law}

def build():
    with Diagram("law", rate=500) as diagram:
        knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, name="knee")
        knee(torque_command=TorqueLimiter(limit=12.0)(Law(name="law")(knee.position, knee.velocity)))
    return diagram
"""
STEADY = "return 3.0 - 20.0 * position - 0.5 * velocity + self.sum"


@pytest.fixture
def recorded(command_line, tmp_path):
    """recorded(path, *words): run a diagram in a folder of its own and return the path of its recording."""
    count = 0

    def record(path, *words, code=OK):
        nonlocal count
        count += 1
        folder = tmp_path / f"recordings{count}"
        assert command_line(path, "--record", folder, *words)[0] == code
        [file] = folder.glob("*.mcap")
        return file

    return record


def law(folder, text=STEADY, name="robot.py"):
    return write(folder, LAW.format(law=text), name)


def test_the_knee_exoskeleton_is_replayed_bit_for_bit(recorded, command_line):
    file = recorded(KNEE_EXO, "--fast", "--duration", "5")
    code, out, err = command_line("replay", file)
    assert (code, err) == (OK, "")
    assert out == (
        f"running {KNEE_EXO}: its content is the recorded one\n"
        f"knee_exo: 1000 ticks of {file.name} replayed with the recorded diagram\n"
        "  all 49 signals and 2004 sent frames are the same, bit for bit\n"
    )
    assert sorted(path.name for path in file.parent.iterdir() if "replay" in path.name) == []


def test_a_real_time_run_with_late_and_missed_ticks_replays_bit_for_bit(recorded, command_line, tmp_path):
    path = law(tmp_path, "if tick in (20, 60): import time; time.sleep(0.007)\n        " + STEADY)
    file = recorded(path, "--duration", "0.3")
    trial = Trial(file)
    assert 0 < len(trial) < 150 and np.diff(trial.tick).max() > 1 and trial.lateness.max() > 0.0
    code, out, _ = command_line("replay", file)
    assert code == OK and "are the same, bit for bit" in out


def test_zero_that_was_set_during_arming_and_a_run_is_replayed_bit_for_bit(recorded, command_line, tmp_path):
    path = write(
        tmp_path,
        """
from blocks.actuators import CubeMars
from blocks.logic import Compare
from blocks.sources import Pulse
from graph import Diagram

def build():
    with Diagram("zeroed", rate=200) as diagram:
        knee = CubeMars("AK80-9", bus="legs", name="knee", zero_at_arming=True)
        knee(torque_command=0.0, zero=Compare(">")(Pulse(delay=0.5)(), 0.5))
    return diagram
""",
    )
    file = recorded(path, "--fast", "--duration", "1")
    code, out, _ = command_line("replay", file)
    assert code == OK and "sent frames are the same, bit for bit" in out
    assert [event["event"] for event in Trial(file).events].count("zero") == 2


def test_blocks_receive_the_recorded_lateness_in_a_replay(recorded, command_line, tmp_path):
    path = write(
        tmp_path,
        """
from blocks.recorders import CsvRecorder
from blocks.clock import Clock
from graph import Diagram

def build():
    with Diagram("late", rate=1000) as diagram:
        Clock()
        CsvRecorder()
    return diagram
""",
    )
    file = recorded(path, "--duration", "0.2")
    assert Trial(file)["clock.lateness"].max() > 0.0
    assert command_line("replay", file)[0] == OK


def test_a_nondeterministic_block_is_reported_with_the_first_differing_tick(recorded, command_line, tmp_path):
    path = law(tmp_path, "return random.random() if tick > 40 else 1.0")
    file = recorded(path, "--fast", "--duration", "0.2")
    code, out, _ = command_line("replay", file)
    assert code == CHECK_FAILED
    assert "the recorded diagram" in out and "first difference: law.torque at tick 41: recorded 0." in out


def test_replay_repeats_a_fault(recorded, command_line, tmp_path):
    path = law(tmp_path, "return 1.0 / (tick - 70)")
    file = recorded(path, "--fast", "--duration", "1", code=FAULT)
    assert Trial(file).tick[-1] == 69
    code, out, _ = command_line("replay", file)
    assert code == OK and "70 ticks of" in out and "bit for bit" in out
    law(tmp_path, "return 1.0 / (tick - 70) if tick != 70 else 0.0")  # the fault is mended
    code, out, _ = command_line("replay", file, "--diagram", path)
    assert code == CHECK_FAILED and "different end: recorded exception at law, replayed ok\n" in out


def test_until_fault_shows_the_inputs_and_outputs_of_the_block_in_80_columns(recorded, command_line, tmp_path):
    path = law(tmp_path, "return 1.0 / (tick - 70)")
    file = recorded(path, "--fast", "--duration", "1", code=FAULT)
    code, out, _ = command_line("replay", "--until-fault", file)
    assert code == FAULT and "bit for bit" in out and "FAULT at law, tick 70 (0.14 s): its step" in out
    inputs, outputs = out.partition("inputs of law:\n")[2].split("outputs of law:\n")
    assert max(map(len, (inputs + outputs).splitlines())) <= 80
    assert inputs.split()[0] == "tick" and "70 (fault)" in inputs
    assert "knee.position in rad" in inputs and "knee.velocity in rad/s" in inputs
    [torque] = [line.split() for line in outputs.splitlines() if "law.torque in N·m" in line]
    assert float(torque[-2]) == -1.0, "of tick 69"
    file = recorded(law(tmp_path, STEADY), "--fast", "--duration", "0.2")
    code, out, _ = command_line("replay", "--until-fault", file)
    assert code == OK and "the run ended: ok, tick 99 (0.198 s)" in out and "inputs of knee:" in out
    file.write_bytes(file.read_bytes()[:-2000])
    code, out, _ = command_line("replay", "--until-fault", file)
    assert code == OK and "the recording does not state how" in out and "inputs of knee:" in out


def test_replay_repeats_a_drive_timeout_in_the_same_tick(command_line, tmp_path):
    with Bus(tmp_path) as bus:
        process = bus.start("--record", "out")
        bus.await_torque()
        bus.drives.kill()
        process.communicate(timeout=10)
    assert process.returncode == FAULT
    [file] = (tmp_path / "out").glob("*.mcap")
    assert Trial(file).end["end"]["status"] == "silent"
    code, out, _ = command_line("replay", file)
    assert code == OK and "bit for bit" in out


def test_an_external_end_is_reported_and_not_replayed(recorded, command_line, tmp_path):
    file = recorded(
        law(tmp_path, "return time.sleep(0.2 * (20 <= tick < 60)) or 1.0"),  # once: the loop then skips to tick 120
        "--overrun",
        "fault:50",
        "--duration",
        "2",
        code=FAULT,
    )
    assert Trial(file).end["end"]["status"] == "overrun"
    code, out, _ = command_line("replay", file)
    assert code == OK and "bit for bit" in out and "external cause, which a replay does not repeat: overrun" in out


def test_a_viewer_added_on_the_command_line_does_not_change_the_diagram(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.2", "--plotjuggler", "127.0.0.1:9")
    code, out, err = command_line("replay", file)
    assert (code, err) == (OK, "") and "the recorded diagram" in out


def test_replay_of_a_changed_diagram_can_be_compared(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.5")
    other = law(tmp_path, STEADY.replace("0.5", "0.6"), "other.py")
    code, out, err = command_line("replay", file, "--diagram", other, "--record", tmp_path / "again")
    assert (
        (code, err) == (CHECK_FAILED, "")
        and "250 ticks" in out
        and "a changed diagram" in out
        and "first difference: law.torque at tick " in out
    )
    [new] = (tmp_path / "again").glob("*_replay.mcap")
    there, here = Trial(file), Trial(new)
    assert here.tick.tolist() == there.tick.tolist()
    assert here["knee.position"].tolist() == there["knee.position"].tolist()  # what was heard stays
    changed = there["law.torque"] - 0.1 * there["knee.velocity"]
    assert here["law.torque"] == pytest.approx(changed, abs=1e-12)
    picture = tmp_path / "diff.png"
    code, out, err = command_line("diff", file, new, "-o", picture)
    assert (
        (code, err) == (CHECK_FAILED, "")
        and "law.torque [N*m]".replace("*", "·") in out
        and picture.read_bytes()[:4] == b"\x89PNG"
    )
    assert (
        command_line.refused("diff", file, new, "-o", "a.jpg")
        == "-o a.jpg: the name of a picture must end in .png, .svg or .pdf"
    )
    (command_line.folder / "diff.png").write_text("dear")
    assert (
        command_line("diff", file, new)[1].splitlines()[-1] == "  diff-2.png"
        and (command_line.folder / "diff.png").read_text() == "dear"
    )
    code, out, err = command_line("diff", file, new, "-o", "nowhere/a.svg")
    assert code == BAD_INPUT and err == "tickwork: cannot write nowhere/a.svg: No such file or directory\n"


@pytest.mark.soak
def test_values_of_a_count_have_no_unit(recorded, command_line, tmp_path):
    counter = """\
from blocks.sources import Constant
from blocks.recorders import CsvRecorder
from graph import Diagram

with Diagram("count", rate=100) as diagram:
    Constant({}, unit="1", name="count")
    CsvRecorder()
"""
    file = recorded(write(tmp_path, counter.format(1.0)), "--fast", "--duration", "0.1")
    other = write(tmp_path, counter.format(3.0), "other.py")
    code, out, _ = command_line("replay", file, "--diagram", other, "--record", tmp_path / "again")
    assert code == CHECK_FAILED and "at tick 0: recorded 1.0, replayed 3.0\n" in out
    [new] = (tmp_path / "again").glob("*.mcap")
    code, out, _ = command_line("diff", file, new)
    assert code == CHECK_FAILED and "\n  count.y           0 " in out


def test_diff_of_other_rates_or_signals_is_no_comparison(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.1")
    faster = recorded(law(tmp_path), "--fast", "--duration", "0.1", "--rate", "1000")
    told = command_line.refused("diff", file, faster)
    assert "was recorded at 500 Hz and " in told and told.endswith("over the gait cycle, with --strides")
    other = recorded(
        write(
            tmp_path,
            """\
from blocks.recorders import CsvRecorder
from blocks.sources import Sine
from graph import Diagram

with Diagram("wave", rate=500) as diagram:
    Sine(name="wave")
    CsvRecorder()
""",
            "wave.py",
        ),
        "--fast",
        "--duration",
        "0.1",
    )
    code, out, _ = command_line("diff", file, other)
    assert code == CHECK_FAILED and out.endswith("\n  no signal is in both\n")


def test_diff_of_a_recording_with_itself_reports_no_difference(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.1")
    code, out, _ = command_line("diff", file, file)
    assert code == OK and "signals are the same, bit for bit" in out and not (command_line.folder / "diff.png").exists()


@pytest.mark.soak
def test_diff_does_not_draw_signals_that_differ_in_the_sign_of_zero_alone(recorded, command_line, tmp_path):
    text = "from blocks.recorders import CsvRecorder\nfrom blocks.sources import Constant\nfrom graph import Diagram\n"
    text += "with Diagram('zero', rate=100) as diagram:\n    Constant({}, name='none')\n    Constant({}, name='one')\n"
    text += "    CsvRecorder()\n"
    files = [
        recorded(write(tmp_path, text.format(*values), f"{name}.py"), "--fast", "--duration", "0.1")
        for name, values in (("a", (0.0, 1.0)), ("b", (-0.0, 1.0)), ("c", (-0.0, 2.0)))
    ]
    told = "  1 signal differs in the sign of zero alone\n"
    code, out, _ = command_line("diff", files[0], files[1])
    assert code == CHECK_FAILED and told in out and "none.y" not in out
    assert not (command_line.folder / "diff.png").exists()
    code, out, _ = command_line("diff", files[0], files[2])
    assert code == CHECK_FAILED and told in out and "none.y" not in out and "one.y" in out
    assert (command_line.folder / "diff.png").exists()


def test_an_unrecorded_bus_ends_the_replay(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.1")
    other = write(tmp_path, LAW.format(law=STEADY).replace('bus="legs"', 'bus="arms"'), "other.py")
    complaint = command_line.refused("replay", file, "--diagram", other)
    assert complaint == "bus 'arms' of the diagram is not in the recording, whose buses are legs"


def test_a_recording_without_a_diagram_requires_one(recorded, command_line, tmp_path):
    path = law(tmp_path)
    file = recorded(path, "--fast", "--duration", "0.1")
    path.unlink()
    code, _, err = command_line("replay", file)
    assert code == BAD_INPUT and "robot.py does not exist" in err
    file = recorded(KNEE_EXO, "--fast", "--duration", "0.1")
    data = json.loads(file.with_suffix(".json").read_text())
    assert data["metadata"]["diagram_file"].endswith("knee_exo.py")


TRAP = "\nopen('trap', 'w').close()\n"
LIBRARY = """
from blocks.sources import Sine
from graph import Diagram

def build():
    with Diagram("waves", rate=100) as diagram:
        Sine(name="wave")
    return diagram
"""


def about_of(file, change):
    """Write a recording anew with another about.json. change : a function of its bytes"""
    data, out = file.read_bytes(), io.BytesIO()
    writer = Writer(out, compression=CompressionType.NONE, use_chunking=False)
    writer.start(library=LIBRARY_NAME)
    channels = {}
    for record in StreamReader(io.BytesIO(data)).records:
        if isinstance(record, Attachment):
            content = change(record.data) if record.name == "about.json" else record.data
            writer.add_attachment(0, 0, record.name, record.media_type, content)
        elif isinstance(record, Channel) and record.id not in channels:
            channels[record.id] = writer.register_channel(record.topic, "protobuf", 0)
        elif isinstance(record, Message):
            writer.add_message(
                channels[record.channel_id], record.log_time, record.data, record.publish_time, record.sequence
            )
    writer.finish()
    file.write_bytes(out.getvalue())


def without(*names):
    """Takes words out of the metadata of an about.json."""

    def change(data):
        about = json.loads(data)
        about["metadata"] = {name: value for name, value in about["metadata"].items() if name not in names}
        return json.dumps(about).encode()

    return change


def test_a_file_that_has_changed_is_not_executed_because_a_recording_names_it(recorded, command_line, tmp_path):
    path = law(tmp_path)
    file = recorded(path, "--fast", "--duration", "0.1")
    path.write_text(path.read_text() + TRAP)
    complaint = command_line.refused("replay", file)
    assert not (tmp_path / "trap").exists()
    assert "robot.py has changed since the recording" in complaint and "--diagram FILE" in complaint
    code, out, err = command_line("replay", file, "--diagram", path)
    assert (code, err) == (OK, "") and "a changed diagram" not in out and (tmp_path / "trap").exists()


def test_a_changed_file_is_replaced_by_the_recorded_diagram_if_it_needs_no_local_code(recorded, command_line, tmp_path):
    path = write(tmp_path, LIBRARY, "waves.py")
    file = recorded(path, "--fast", "--duration", "0.1")
    code, out, _ = command_line("replay", file)
    assert code == OK and out.startswith(f"running {path}: its content is the recorded one\n")
    path.write_text(LIBRARY + TRAP)
    code, out, err = command_line("replay", file)
    assert (
        (code, err) == (OK, "")
        and not (tmp_path / "trap").exists()
        and "bit for bit" in out
        and "the recorded diagram" in out
    )
    assert (
        f"  the diagram in the recording was used: {path} has changed since the recording. Pass --diagram FILE to "
        "use a file\n"
    ) in out


def test_an_old_recording_without_a_file_hash_requires_an_explicit_diagram(recorded, command_line, tmp_path):
    path = law(tmp_path)
    file = recorded(path, "--fast", "--duration", "0.1")
    assert (
        json.loads(file.with_suffix(".json").read_text())["metadata"]["source_sha256"]
        == hashlib.sha256(path.read_bytes()).hexdigest()
    )
    about_of(file, without("source_sha256"))
    path.write_text(path.read_text() + TRAP)
    complaint = command_line.refused("replay", file)
    assert "the recording has no hash of " in complaint and not (tmp_path / "trap").exists()
    assert command_line("replay", file, "--diagram", path)[0] == OK


@pytest.mark.parametrize("depth", soaked([100, 900, 5_000, 200_000], but=[0, 3]))
@pytest.mark.parametrize(
    "command", [("replay",), ("convert", "--to", "csv"), ("convert", "--to", "mcap"), ("plot",)], ids="-".join
)
def test_an_about_json_of_any_depth_is_refused_in_one_line(recorded, command_line, tmp_path, depth, command):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.02")
    about_of(
        file,
        lambda data: (
            data.rstrip()[:-1] + b', "deep": ' + b'{"a": [' * (depth // 2) + b"1" + b"]}" * (depth // 2) + b"}"
        ),
    )
    assert command_line.refused(command[0], file, *command[1:]) == (
        f"{file.relative_to(tmp_path)} is damaged: its about.json is nested more than 64 levels deep"
    )


def test_an_about_json_as_deep_as_a_recorder_may_write_it_is_read(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.02")
    about_of(file, lambda data: data.rstrip()[:-1] + b', "deep": ' + b"[" * 60 + b"]" * 60 + b"}")
    assert command_line("replay", file)[0] == OK


def test_control_characters_of_a_recording_never_reach_the_terminal(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.02")
    about_of(file, lambda data: data.replace(b"robot.py", b"\\u001b]0;title\\u0007\\u001b[2J.py"))
    complaint = command_line.refused("replay", file)
    assert (
        "\\x1b]0;title\\x07\\x1b[2J.py does not exist" in complaint
        and "\x1b" not in complaint
        and "\x07" not in complaint
    )


def test_a_file_that_changes_between_the_comparison_and_the_import_is_not_executed(tmp_path):
    path = write(tmp_path, LIBRARY + TRAP, "waves.py")
    with pytest.raises(BadInput, match="changed while it was read"):
        load(path, sha256=hashlib.sha256(LIBRARY.encode()).hexdigest())
    assert not (tmp_path / "trap").exists() and not Path("trap").exists()


def test_a_replay_through_another_file_records_that_file(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "0.1")
    other = law(tmp_path, "return 1.0", "other.py")
    command_line("replay", file, "--diagram", other, "--record", tmp_path / "again")
    [new] = (tmp_path / "again").glob("*_replay.mcap")
    code, out, _ = command_line("replay", new)
    assert code == OK and out.startswith(f"running {other}: ") and "bit for bit" in out


def test_files_that_are_not_recordings_are_rejected(command_line, tmp_path):
    assert command_line.refused("replay", "nowhere.mcap") == "nowhere.mcap: No such file or directory"
    (command_line.folder / "text.mcap").write_text("hello")
    assert command_line.refused("replay", "text.mcap") == (
        "text.mcap is not a recording of Tickwork: pass the .mcap file of the run"
    )


def test_a_recording_that_was_cut_anywhere_is_replayed_up_to_its_last_complete_tick(recorded, command_line, tmp_path):
    file = recorded(law(tmp_path), "--fast", "--duration", "2")
    data = file.read_bytes()
    [chunk] = chunks(data)
    for share in (0.3, 0.6, 0.9):
        cut = file.with_name("cut.mcap")
        cut.write_bytes(data[: chunk.chunk_start_offset + int(share * chunk.chunk_length)])
        trial = Trial(cut)
        code, out, _ = command_line("replay", cut)
        assert not trial.complete and 200 < len(trial) < 1000
        assert code == OK and f"{len(trial)} ticks of cut.mcap" in out and "the recording is incomplete" in out


def test_the_recording_of_a_killed_run_is_replayed(command_line, tmp_path):
    path = law(tmp_path)
    how = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = started(path, "--record", tmp_path / "killed", cwd=ROOT, **how)
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline and not any(
        file.stat().st_size > 60_000 for file in (tmp_path / "killed").glob("*.mcap")
    ):
        time.sleep(0.02)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    [sidecar] = (tmp_path / "killed").glob("*.json")
    while time.monotonic() < deadline and json.loads(sidecar.read_text())["ended"] != "the control process died":
        time.sleep(0.02)
    [file] = (tmp_path / "killed").glob("*.mcap")
    code, out, err = command_line("replay", file)
    assert code == OK, out + err


@pytest.mark.soak
def test_a_run_whose_recorder_was_killed_is_replayed_from_all_its_parts(command_line, tmp_path):
    run = started(KNEE_EXO, "--fast", "--duration", "15", "--record", tmp_path, cwd=tmp_path)
    patient(lambda: any(path.stat().st_size > 200_000 for path in tmp_path.glob("*.mcap")))
    os.kill(writer_of(run.pid), signal.SIGKILL)
    run.communicate(timeout=60)
    first = min(tmp_path.glob("*.mcap"), key=lambda path: len(path.name))
    assert run.returncode == OK and first.with_stem(f"{first.stem}_part2").exists()
    code, out, err = command_line("replay", first)
    assert (code, err) == (OK, "") and f"3000 ticks of {first.name} replayed" in out and "the same, bit for bit" in out
    code, out, err = command_line("convert", first, "--to", "mcap", "-o", tmp_path / "whole")
    assert (code, err) == (OK, "") and len(Trial(out.strip()).parts) == 1
    code, out, err = command_line("replay", out.strip())
    assert (code, err) == (OK, "") and f"3000 ticks of {first.name} replayed" in out and "the same, bit for bit" in out


def test_settings_of_the_recorded_run_are_used_again(recorded, command_line):
    file = recorded(
        KNEE_EXO,
        "--fast",
        "--duration",
        "1",
        "--rate",
        "100",
        "--set",
        "assistance=0.5",
        "--set",
        "left/gate.fade_in=0.4",
    )
    code, out, err = command_line("replay", file)
    assert (code, err) == (OK, "") and "100 ticks" in out and "the recorded diagram" in out


@pytest.mark.parametrize("folder", soaked(["/proc/self/mem", "9" * 300, "/dev/null"], but=[0]))
def test_a_folder_that_cannot_be_recorded_into_is_refused_in_a_line(tmp_path, folder):
    assert finished(knee(tmp_path), "--fast", "--duration", "0.5", cwd=tmp_path).returncode == 0
    [recording] = (tmp_path / "recordings").glob("*.mcap")
    process = finished("replay", recording, "--record", folder, cwd=tmp_path)
    assert process.returncode == 2 and process.stderr.startswith("tickwork: cannot record into "), process.stderr
    assert len(process.stderr.splitlines()) == 1
