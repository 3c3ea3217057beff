"""The command line: what it takes, what it refuses in one line, and how it behaves where its output goes nowhere."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import pytest

import runtime
from runtime.cli.main import COMMANDS, system_error
from runtime.cli.run import parse_run
from runtime.host.console.terminal import program
from runtime.host.errors import BAD_INPUT, CHECK_FAILED, OK
from runtime.session.request import Request
from tests.runtime.runs import KNEE, KNEE_EXO, environment, finished, knee, line_of, started, write
from tests.soaking import soaked

LISTS = "lists the options)"


def test_help_names_the_commands_and_every_option(command_line, golden):
    code, out, err = command_line("--help")
    golden("help", out)
    assert (code, err) == (OK, "")
    assert max(map(len, out.splitlines())) < 80 and sys.executable not in out
    commands = [match for line in out.splitlines() if (match := re.fullmatch(r"  (\w+) +(\S.*)", line))]
    assert [match[1] for match in commands] == list(COMMANDS) and len({match.start(2) for match in commands}) == 1
    with pytest.raises(SystemExit) as ended:
        command_line("run", "--help")
    assert ended.value.code == OK
    out = command_line.capsys.readouterr().out
    for option in ("FILE", "--rate", "--duration", "--fast", "--set", "--record", "--no-record", "--plotjuggler"):
        assert option in out


def test_without_arguments_the_usage_is_printed(command_line):
    assert command_line.refused().startswith("usage: python -m runtime FILE")


@pytest.mark.parametrize("words", [["run"], ["check"], ["--duration", "1"], ["--fast"]])
def test_a_missing_file_argument_is_reported(command_line, words):
    assert command_line.refused(*words).startswith("no diagram file given: pass one, such as diagrams/knee_exo.py")


@pytest.mark.parametrize("word", ["caf\udce9.py", "notes=caf\udce9"])
def test_an_argument_that_is_not_utf_8_is_refused_before_anything_runs(command_line, word):
    shown = word.replace("\udce9", "\\xe9")
    assert command_line.refused(KNEE_EXO, "--trial", word) == (
        f"the argument '{shown}' is not valid UTF-8: retype it, or rename the file"
    )


@pytest.mark.parametrize("word, meant", [("chek", "check"), ("benhc", "bench"), ("runn", "run")])
def test_a_mistyped_command_is_suggested(command_line, word, meant):
    assert command_line.refused(word) == f"{word!r} is neither a command nor a file; did you mean {meant!r}?"


@pytest.mark.parametrize(
    "word, meant",
    [
        ("--durration", "--duration"),
        ("--dur", "--duration"),
        ("--recrod", "--record"),
        ("--plotjugler", "--plotjuggler"),
    ],
)
def test_a_mistyped_option_is_suggested_and_never_completed(command_line, word, meant):
    complaint = command_line.refused(KNEE_EXO, word, "1", "--duration", "1")
    assert complaint.startswith(f"there is no option {word}; did you mean {meant!r}?") and complaint.endswith(LISTS)


def test_unknown_options_and_unexpected_arguments_are_reported(command_line):
    assert command_line.refused(KNEE_EXO, "--xyzzy").startswith("there is no option --xyzzy (")
    assert command_line.refused(KNEE_EXO, "ten").startswith("unexpected argument 'ten'")
    assert command_line.refused(KNEE_EXO, "--rate").startswith("argument --rate: expected one argument")
    assert "not allowed with" in command_line.refused(KNEE_EXO, "--record", "here", "--no-record")
    assert command_line.refused("emulate", KNEE_EXO).startswith("missing argument --rig (")


@pytest.mark.parametrize("value", ["0", "-3", "nan", "inf", "-inf", "fast", "", "1/2", "200Hz"])
def test_an_impossible_rate_is_rejected_on_the_command_line(command_line, value):
    assert command_line.refused(KNEE_EXO, f"--rate={value}") == f"--rate {value}: expected a number of Hz above 0"


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "long", "10s"])
def test_an_impossible_duration_is_rejected(command_line, value):
    assert command_line.refused(KNEE_EXO, f"--duration={value}") == (
        f"--duration {value}: expected a number of seconds above 0"
    )


def test_rates_and_durations_are_bounded(command_line):
    assert command_line.refused(KNEE_EXO, "--rate", "1e9") == "rate 1e+09 Hz is above the limit of 100000 Hz"
    assert command_line.refused(KNEE_EXO, "--duration", "1e300") == "--duration 1e300: at most 1e+09 seconds"
    assert command_line.refused(KNEE_EXO, "--duration", "0.001") == (
        "--duration 0.001: shorter than one tick, which takes 0.005 s"
    )


def test_virtual_time_requires_a_duration(command_line):
    assert command_line.refused(KNEE_EXO, "--fast").startswith("--fast needs --duration S")


@pytest.mark.parametrize("text", ["assistance", "=3", ""])
def test_a_setting_without_name_or_value_is_rejected(command_line, text):
    assert command_line.refused(KNEE_EXO, "--set", text) == (
        f"--set {text}: expected NAME=VALUE, as in --set left/impedance.stiffness=40"
    )


def test_a_mistyped_setting_is_suggested(command_line):
    refused = command_line.refused
    assert "did you mean 'assistance'?" in refused(KNEE_EXO, "--set", "asistance=0.5")
    assert "did you mean 'stride_time'?" in refused(KNEE_EXO, "--set", "stride_tim=0.5")
    assert refused(KNEE_EXO, "--set", "left/profil.scale=1") == (
        "setting left/profil.scale=1: knee_exo has no block 'left/profil'; did you mean 'left/profile.scale'?"
    )
    assert refused(KNEE_EXO, "--set", "left/profile.scal=1") == (
        "setting left/profile.scal=1: left/profile has no parameter 'scal'; did you mean 'scale'?"
    )
    assert "did you mean 'left/profile.scale'?" in refused(KNEE_EXO, "--set", "profile.scale=1")


def test_an_unknown_setting_lists_the_known_ones(command_line):
    assert "it has assistance, gait, stride_time" in command_line.refused(KNEE_EXO, "--set", "zzz=1")
    assert "its blocks are csv_recorder, left/butterworth, " in command_line.refused(KNEE_EXO, "--set", "zzz.q=1")
    assert "it has points, scale" in command_line.refused(KNEE_EXO, "--set", "left/profile.zzz=1")
    assert "BLOCK.PARAMETER" in command_line.refused(KNEE_EXO, "--set", "left/profile=1")


@pytest.mark.parametrize(
    "setting, words",
    [
        ("left/profile.scale=2", "scale: must be at most 1.0, got 2.0; scale factor of the profile"),
        ("left/profile.scale=-0.1", "scale: must be at least 0.0, got -0.1"),
        ("left/profile.scale=nan", "scale: NaN is not allowed"),
        ("left/profile.scale=much", "scale: 'much' is not a number"),
        ("left/profile.scale=", "scale: '' is not a number"),
        ("left/profile.points=1", "points: cannot be set as text"),
        ("left/butterworth.order=2.5", "order: expected a whole number"),
        ("left/knee.invert=perhaps", "invert: expected true or false, got 'perhaps'"),
        ("left/knee.model=AK10-90", "did you mean 'AK10-9-V2.0'?"),
        ("left/knee.offset=1 s", "does not convert"),
        ("assistance=much", "expected a number, such as 1.0"),
    ],
)
def test_an_invalid_setting_is_reported(command_line, setting, words):
    complaint = command_line.refused(KNEE_EXO, "--set", setting)
    assert complaint.startswith(f"setting {setting}: ") and words in complaint and "\n" not in complaint


def test_a_setting_rejected_by_the_file_is_reported_with_its_line(command_line):
    line = line_of(KNEE_EXO, "TorqueProfile(")
    assert command_line.refused(KNEE_EXO, "--set", "assistance=3") == (
        f"{KNEE_EXO}:{line}: error TW010 wrong parameter: TorqueProfile: scale: must be at most 1.0, got 3.0\n"
        "    scale factor of the profile"
    )


def test_a_setting_that_breaks_the_proof_is_refused_by_the_compiler(command_line):
    complaint = command_line.refused(KNEE_EXO, "--set", "left/torque_limiter.limit=30", code=CHECK_FAILED)
    assert (
        "left/knee.torque_command: left/torque_limiter.limited can reach [-30, 30] N·m" in complaint
        and "tickwork: 1 error; nothing was armed" in complaint
    )


def test_unusable_gait_file_is_reported(command_line):
    line = line_of(KNEE_EXO, "recording=gait")
    assert command_line.refused(KNEE_EXO, "--set", "gait=nowhere.csv") == (
        f"{KNEE_EXO}:{line}: error TW010 wrong parameter: walker: recording: there is no nowhere.csv in "
        f"{Path(KNEE_EXO).parent} or in the working folder: copy it there, or write its absolute path"
    )
    write(
        command_line.folder,
        "time," + ",".join(f"column_{n}" for n in range(500)) + "\n1" + 500 * ",1" + "\n",
        "walk.csv",
    )
    complaint = command_line.refused(KNEE_EXO, "--set", "gait=walk.csv")
    assert (
        "walk.csv has no column 'hip_flexion_lt_deg' or 'hip_flexion_l'; it has time, column_0, column_1, " in complaint
        and len(complaint) < 600
    )


@pytest.mark.parametrize(
    "where", soaked(["", "robot.py", "robot.py/below", "/proc", "/proc/below", "/sys/below", "/dev/null"], but=[1, 3])
)
def test_a_folder_that_cannot_be_written(command_line, where):
    knee(command_line.folder)
    complaint = command_line.refused("robot.py", "--duration", "1", "--record", where)
    assert (
        complaint.startswith(f"cannot record into {where!r}: " if where else "--record: expected a folder")
        and "\n" not in complaint
    )


def test_a_file_name_in_place_of_the_folder(command_line):
    knee(command_line.folder)
    for name in ("trials/knee.csv", "knee.mcap", "knee.json"):
        assert command_line.refused("robot.py", "--duration", "1", "--record", name) == (
            f"--record {name}: expected a folder; the files in it have the name of the diagram"
        )
    assert not (command_line.folder / "trials").exists()


def test_the_default_folder_that_cannot_be_written(command_line):
    knee(command_line.folder)
    write(command_line.folder, "in the way", "recordings")
    assert command_line.refused("robot.py", "--duration", "1") == (
        "cannot record into 'recordings': recordings is not a folder"
    )


@pytest.mark.parametrize(
    "address", ["", "host:", ":9870", "host:port", "host:0", "host:65536", "host:-1", "1.2.3.4:98.7"]
)
def test_an_impossible_address_is_rejected(command_line, address):
    assert command_line.refused(KNEE_EXO, "--plotjuggler", address) == (
        f"--plotjuggler {address}: expected HOST:PORT, as in 127.0.0.1:9870"
    )


def test_addresses_have_a_default_port_and_may_be_of_version_6():
    def address(text):
        return parse_run(["robot.py", "--plotjuggler", text]).plotjuggler

    assert address("laptop") == ("laptop", 9870)
    assert address("10.0.0.7:1234") == ("10.0.0.7", 1234)
    assert address("[::1]:1234") == ("::1", 1234)


def test_a_folder_may_start_with_a_tilde(monkeypatch, tmp_path):
    """Also behind `--record=`, where no shell expands it."""
    monkeypatch.setenv("HOME", str(tmp_path))
    assert parse_run(["robot.py", "--record=~/runs"]).record == tmp_path / "runs"


def test_a_host_that_does_not_resolve(command_line):
    complaint = command_line.refused(
        knee(command_line.folder), "--duration", "1", "--plotjuggler", "robot.invalid:9870"
    )
    assert complaint.startswith("plot_juggler cannot start: unknown host 'robot.invalid'") and "\n" not in complaint


PLANT = """

def plant(robot, rate=1000.0, bus="legs"):
    from blocks.actuators import EmulatedCubeMars

    with Diagram("plant", rate=rate) as plant:
        EmulatedCubeMars("AK10-9-V2.0", bus=bus, can_id=1)(position=0.0, velocity=0.0)
    return plant
"""


@pytest.mark.parametrize("rate", [250, 300.5, 100, 200.0001])
def test_a_plant_rate_that_is_not_a_multiple_is_rejected(command_line, rate):
    write(command_line.folder, KNEE.format(law="return 0.0") + PLANT)
    assert command_line.refused("robot.py", "--duration", "1", "--set", f"rate={rate}") == (
        f"the plant runs at {rate:g} Hz, which is not a whole multiple of the robot's 200 Hz: set a multiple, "
        "such as rate=5 * robot.rate"
    )


def test_a_plant_on_an_unknown_bus(command_line):
    write(command_line.folder, KNEE.format(law="return 0.0") + PLANT)
    assert command_line.refused("robot.py", "--duration", "1", "--set", "bus=arms") == (
        "the plant emulates a device on bus 'arms', but the robot's buses are legs"
    )


def test_a_plant_that_does_not_compile(command_line):
    path = write(
        command_line.folder,
        KNEE.format(law="return 0.0") + PLANT.replace("(position=0.0, velocity=0.0)", "(position=0.0)"),
    )
    complaint = command_line.refused("robot.py", "--duration", "1", code=CHECK_FAILED)
    line = line_of(path, "EmulatedCubeMars(")
    assert complaint.startswith(f"robot.py:{line}: error TW001 unconnected input: emulated_cube_mars.velocity")


def test_check_reports_the_proofs(command_line):
    code, out, err = command_line("check", KNEE_EXO)
    assert (code, err) == (OK, "")
    assert re.match(r"knee_exo  .*knee_exo.py: 200 Hz, 19 blocks, 42 wires, its own plant at 1000 Hz\n", out)
    assert out.count("[-12, 12] inside [-18, 18] N·m") == 2
    for side in ("left", "right"):
        assert f"bounded by {side}/torque_limiter, " in out
    assert out.splitlines()[-1] == "ok: every command of 2 actuators is proved, 0 warnings"
    knee(command_line.folder)
    assert re.search(r"\d+  law +Python ", command_line("check", "robot.py")[1])


def test_check_rejects_every_rig_that_run_rejects(command_line):
    assert command_line.refused("check", "nothing.py") == "file nothing.py does not exist"
    for options, said in (
        (
            ("--set", "left/torque_limiter.limit=30"),
            "left/torque_limiter.limited can reach [-30, 30] N·m, and the limit is [-18, 18] N·m",
        ),
        (("--rate", "30"), "a cutoff of 20 Hz requires a rate above 40 Hz"),
    ):
        code, out, err = command_line("check", KNEE_EXO, *options)
        assert code == CHECK_FAILED and said in out and "the diagram cannot run" in out and not err


@pytest.mark.parametrize("words, collects", [((), False), (("check",), True)], ids=["run", "check"])
def test_a_run_starts_without_garbage_collection_and_other_commands_collect(tmp_path, words, collects):
    write(tmp_path, f"import gc\n\nprint('collects', gc.isenabled())\n{KNEE.format(law='return 0.0')}")
    options = () if words else ("--fast", "--duration", "0.1")
    process = finished(*words, "robot.py", *options, cwd=tmp_path, cold=True)
    assert process.returncode == OK and f"collects {collects}\n" in process.stdout, process


def test_warnings_do_not_prevent_a_run(command_line):
    idle = "    Law(name='idle')(knee.position, knee.velocity)"
    path = write(command_line.folder, KNEE.format(law="return 0.0").replace("    CsvRecorder()", idle))
    code, out, err = command_line("check", "robot.py")
    assert code == OK and "warning TW020 unused outputs" in out and f"robot.py:{line_of(path, 'idle')}\n" in out
    code, out, err = command_line("robot.py", "--fast", "--duration", "1")
    assert code == OK and f"robot.py:{line_of(path, 'idle')}: warning TW020" in err


def test_bench_refuses_impossible_numbers(command_line):
    assert command_line.refused("bench", "--seconds", "0") == "--seconds 0: expected a number of seconds above 0"
    for repeats in ("0", "-1", "x", "1.5"):
        assert command_line.refused("bench", f"--repeats={repeats}") == (
            f"--repeats {repeats}: expected a whole number, 1 or more"
        )


@pytest.mark.parametrize(
    "words, code",
    soaked(
        [
            ([KNEE_EXO, "--rate", "0"], BAD_INPUT),
            (["nothing.py"], BAD_INPUT),
            ([KNEE_EXO, "--record", "/proc"], BAD_INPUT),
            ([KNEE_EXO, "--set", "left/torque_limiter.limit=30"], CHECK_FAILED),
            (["--help"], OK),
        ],
        but=[2, 3],
    ),
)
def test_a_real_process_ends_with_the_same_codes(tmp_path, words, code):
    process = finished(*words, cwd=tmp_path, cold=True)
    assert process.returncode == code
    assert (process.stdout == "") is (code != OK) and "Traceback" not in process.stderr
    assert list(tmp_path.iterdir()) == []


def test_relative_file_names_work_from_another_folder(tmp_path):
    """Recordings go into the working folder, wherever the diagram lies."""
    (tmp_path / "robots").mkdir()
    (tmp_path / "work").mkdir()
    knee(tmp_path / "robots")
    process = finished("../robots/robot.py", "--fast", "--duration", "0.5", cwd=tmp_path / "work")
    assert process.returncode == OK, process.stderr
    assert [path.name for path in (tmp_path / "work").iterdir()] == ["recordings"]
    assert "recordings/robot_" in process.stdout
    assert [path.name for path in (tmp_path / "robots").iterdir() if path.name != "__pycache__"] == ["robot.py"]


def test_suggested_commands_are_valid(monkeypatch, tmp_path):
    """Python by its short name where the shell finds it by that; by its path, from here, in an environment that is not
    activated.
    """
    binaries = tmp_path / ".venv" / "bin"
    binaries.mkdir(parents=True)
    for name in ("python", "python3", "tickwork"):
        (binaries / name).symlink_to(sys.executable)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "executable", str(binaries / "python"))
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "runtime" / "__main__.py")])
    assert program() == ".venv/bin/python -m runtime"
    monkeypatch.setattr(sys, "argv", [str(binaries / "tickwork")])
    assert program() == ".venv/bin/tickwork"
    monkeypatch.setenv("PATH", str(binaries))
    assert program() == "tickwork"
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "runtime" / "__main__.py")])
    assert program() == "python -m runtime"
    (binaries / "python").unlink()
    assert program() == "python3 -m runtime"


def test_the_console_script_is_the_same(tmp_path):
    """`tickwork` calls runtime.__main__:main; it names itself in what it suggests."""
    knee(tmp_path)
    script = write(tmp_path, "import sys\nfrom runtime.__main__ import main\nsys.exit(main())\n", "tickwork")
    script.chmod(0o755)
    process = subprocess.run(
        [sys.executable, script, "robot.py", "--fast", "--duration", "0.5", "--no-record"],
        cwd=tmp_path,
        env=environment(PATH=f"{tmp_path}:/usr/bin:/bin"),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert process.returncode == OK, process.stderr
    assert "  show what is proved: tickwork check robot.py\n" in process.stdout


def test_a_closed_output_pipe_does_no_harm(tmp_path):
    """`... | head -1`: the run ends as it would have, and says nothing about it."""
    knee(tmp_path)
    process = started("robot.py", "--fast", "--duration", "1", cwd=tmp_path)
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert (process.wait(60), error) == (OK, "")
    assert len(list((tmp_path / "recordings").iterdir())) == 3


def test_a_closed_output_pipe_does_not_hide_a_fault(tmp_path):
    knee(tmp_path, law="return math.nan if tick == 100 else 0.0")
    process = started("robot.py", "--fast", "--duration", "1", "--no-record", cwd=tmp_path)
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert process.wait(60) == 3 and error.startswith("FAULT at knee")


def test_a_closed_output_pipe_does_not_break_the_help(tmp_path):
    process = started("check", "--help", cwd=tmp_path)
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert (process.wait(60), error) == (OK, "")


def test_a_file_that_raises_keyboard_interrupt_ends_the_command_as_ctrl_c_does(command_line):
    write(command_line.folder, "raise KeyboardInterrupt")
    code, out, error = command_line("check", "robot.py")
    assert (code, out) == (130, "") and "KeyboardInterrupt in user code" in error and "Traceback" not in error


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (
            ImportError("libx.so: failed to map segment"),
            "a library cannot be imported (libx.so: failed to map segment)",
        ),
        (MemoryError(), "out of memory"),
    ],
)
def test_a_library_that_a_command_cannot_load_is_reported_in_one_line(command_line, monkeypatch, error, text):
    def run(name, arguments, folder):
        if isinstance(error, ImportError):
            raise ImportError("advice") from error
        raise error

    monkeypatch.setattr("runtime.cli.main.run", run)
    assert text in command_line.refused("doctor")


RESULTS = {
    "a run": ("robot.py", "--fast", "--duration", "1", "--no-record"),
    "a check": ("check", "robot.py"),
    "a document": ("check", "robot.py", "--json"),
    "a list": ("blocks",),
    "a drawing": ("draw", "robot.py", "--format", "mermaid", "-o", "-"),
    "the help": ("--help",),
    "the help of a command": ("check", "--help"),
    "the version": ("--version",),
}


@pytest.mark.parametrize("words", soaked([[*words] for words in RESULTS.values()], but=[0]), ids=RESULTS)
def test_a_result_that_standard_output_does_not_take_is_an_error(tmp_path, words):
    knee(tmp_path)
    with open("/dev/full", "w") as full:
        process = started(*words, cwd=tmp_path, stdout=full)
        error = process.communicate(timeout=60)[1]
    line = "tickwork: cannot write to standard output: No space left on device\n"
    assert (process.returncode, error) == (BAD_INPUT, line)


@pytest.mark.parametrize("words", soaked([[*words] for words in RESULTS.values()], but=[0, 4]), ids=RESULTS)
def test_an_output_whose_reader_ends_early_is_no_error(tmp_path, words):
    """As with `| head -c 1`."""
    knee(tmp_path)
    process = started(*words, cwd=tmp_path)
    process.stdout.buffer.raw.read(1)
    process.stdout.close()
    error = process.stderr.read()
    process.stderr.close()
    assert (process.wait(60), error) == (OK, "")


@pytest.mark.parametrize("words", soaked([[*words] for words in RESULTS.values()], but=[0]), ids=RESULTS)
def test_a_closed_standard_output_is_no_error(tmp_path, words):
    knee(tmp_path)
    command = f"{sys.executable} -m runtime {' '.join(words)} >&-"
    process = subprocess.run(["bash", "-c", command], cwd=tmp_path, env=environment(), capture_output=True, timeout=60)
    assert (process.returncode, process.stderr) == (OK, b"")


def test_closed_standard_streams_do_no_harm(tmp_path):
    """No file of ours may get the number of a stream: whoever writes to standard error would write into it."""
    knee(tmp_path)
    process = subprocess.run(
        ["sh", "-c", f"exec {sys.executable} -m runtime robot.py --fast --duration 1 0<&- 1>&- 2>&-"],
        cwd=tmp_path,
        env=environment(),
        timeout=60,
    )
    assert process.returncode == OK
    assert len(list((tmp_path / "recordings").iterdir())) == 3


def test_output_is_adapted_to_the_encoding_of_the_terminal(tmp_path):
    knee(tmp_path)
    process = finished(
        "robot.py", "--fast", "--duration", "1", "--no-record", cwd=tmp_path, PYTHONIOENCODING="ascii:strict"
    )
    assert process.returncode == OK and "knee: 1 s at 200 Hz" in process.stdout and process.stdout.isascii()


@pytest.mark.soak
def test_the_packages_may_be_anywhere(tmp_path):
    """Nothing depends on where the checkout lies or what the working folder is called."""
    process = finished(KNEE_EXO, "--fast", "--duration", "0.5", "--no-record", cwd="/", cold=True)
    assert process.returncode == OK, process.stderr


def test_every_field_of_a_request_is_an_option_of_run(command_line):
    """An option is declared in Request and nowhere else: the parser, its help and the Request follow."""
    with pytest.raises(SystemExit):
        command_line("run", "--help")
    out = command_line.capsys.readouterr().out
    declared = [field for field in dataclasses.fields(Request) if field.metadata]
    assert {field.name for field in dataclasses.fields(Request)} - {field.name for field in declared} == {"bench"}
    for field in declared:
        assert all(re.search(rf"^  {flag}\b", out, re.MULTILINE) for flag in field.metadata["flags"])
    plain = parse_run(["robot.py"])
    assert plain == Request(file=Path("robot.py"))
    words = "--fast --duration 2 --seed 7 --set a.b=1 --set c=2 --trial subject=S03 --record x".split()
    assert parse_run(["robot.py", *words]) == Request(
        file=Path("robot.py"),
        fast=True,
        duration=2.0,
        seed=7,
        settings=[("a.b", "1"), ("c", "2")],
        trial={"subject": "S03"},
        record=Path("x"),
    )


def test_a_seed_gives_the_same_noise_on_the_command_line_and_in_python(command_line):
    write(
        command_line.folder,
        "from blocks.recorders import CsvRecorder\nfrom blocks.sources import GaussianNoise\n"
        "from graph import Diagram\n"
        "with Diagram('noise', rate=100) as diagram:\n    GaussianNoise(name='a')()\n    CsvRecorder()\n",
    )
    assert command_line("robot.py", "--fast", "--duration", "1", "--seed", "5")[0] == OK
    [path] = command_line.folder.glob("recordings/*.mcap")
    recorded = runtime.load(path)
    assert recorded["a.y"].tolist() == runtime.run("robot.py", 1, seed=5)["a.y"].tolist()
    assert recorded["a.y"].tolist() != runtime.run("robot.py", 1)["a.y"].tolist()
    assert command_line.refused("robot.py", "--seed", "x") == "--seed x: expected a whole number, 0 or more"


@pytest.mark.parametrize("command", ["run", "check", "draw", "replay", "plot", "convert", "diff", "profile"])
def test_a_name_that_is_too_long_for_a_file_is_refused_in_a_line(command_line, command):
    more = ["y"] if command == "diff" else []
    said = command_line.refused(command, "x" * 300, *more)
    assert "Traceback" not in said and len(said.splitlines()) == 1


def test_a_file_in_a_folder_without_permission_is_reported_in_a_line():
    assert system_error(PermissionError(13, "Permission denied", "/srv/a.mcap")) == "/srv/a.mcap: Permission denied"
