"""Constants that pages print are those of the code."""

import inspect
import math
import re

import pytest

from blocks.actuators import CubeMars, CubeMarsServo, CubeMarsV3, RobStride
from blocks.actuators.cubemars import servo
from blocks.imus import MPU9250, OpenImu
from blocks.networks import OnnxModel
from blocks.safety import EStopHeartbeat
from blocks.sinks import PlotJuggler, Rerun
from cext.safety import thresholds
from cext.schedule.mailbox_writer import CHANGE_LIMIT
from graph.conformance import check_block
from graph.declarations import RAMP_TIME
from runtime.cli import optimise
from runtime.experiments.optimisation import costs, description, metabolic, protocol
from runtime.host import errors
from runtime.host.machine import realtime
from runtime.record.analysis import average_stride
from runtime.record.recorder import process, status, writer
from runtime.record.recorder.services import rerun
from runtime.record.storage import files, grouping, mcap_file
from runtime.robot.emulation import priority
from runtime.robot.guardian import handover, wires
from runtime.session import own_process
from runtime.setup.commissioning.calibration import fits, stillness
from tests.checkout import ROOT
from tests.docs.block_pages import homes
from tests.docs.pages import NAMES

PYPROJECT = (ROOT / "pyproject.toml").read_text()


def safe(name, factor=1e9):
    """Return a safety threshold: a time in s, or another value with its factor."""
    return getattr(thresholds, name) / factor


def default(block, parameter):
    return block.parameters[parameter].default


def native(path, name):
    """Return a constant of a Cython module."""
    return float(re.search(rf"\b{name} = (\d+)", (ROOT / "cext" / path).read_text())[1])


PORT = default(PlotJuggler, "port")
STRIDES = (average_stride.STRIDE_MINIMUM, average_stride.STRIDE_LIMIT)  # s
WHEELS = [int(minor) for minor in re.findall(r'"cp3(\d+)-manylinux', PYPROJECT)]
PYTHONS = (min(WHEELS), max(WHEELS))  # minor versions
TRIED_PYTHONS = tuple(int(minor) for minor in re.findall(r" 3\.(\d+)", (ROOT / ".ci/pythons").read_text())[:2])
GLIBC = int(re.search(r'manylinux-x86_64-image = "manylinux_2_(\d+)"', PYPROJECT)[1])
MS = 1e3
STALL = safe("LOOP_STALL_MINIMUM") * MS
RETRY, CHECK = (native("lines/i2c.pyx", name) / 1e6 for name in ("RETRY", "CHECK"))  # ms
PRINTED = [  # page, pattern in its text, in one line, whose groups are numbers, and their values
    ("coming_from/epically_powerful", r"silence of ([\d.]+) s ends the run", default(CubeMars, "timeout")),
    ("coming_from/epically_powerful", r"\| (\d+), the default of PlotJuggler", PORT),
    ("coming_from/epically_powerful", r"AK70-10 \| [\d.]+ N·m \| ([\d.]+) N·m", CubeMars("AK70-10").torque_limit),
    (
        "explanation/realtime",
        r"priority (\d+) \(`--priority`, (\d+) at most\)",
        (realtime.PRIORITY, realtime.PRIORITY_LIMIT),
    ),
    ("explanation/realtime", r"(\d+) KiB of stack", realtime.STACK / 1024),
    ("explanation/realtime", r"scheduling slice of ([\d.]+) ms", realtime.SLICE / 1e6),
    ("explanation/speed", r"pieces of\s(\d+) KiB", files.AT_ONCE / 1024),
    ("explanation/tour", r"not after (\d+) ms is reported", safe("STOP_LIMIT") * MS),
    ("how_to/optimisation", r"`--settle (\d+)`, `--measure (\d+)`", (optimise.SETTLE, optimise.MEASURE)),
    ("how_to/optimisation", r": (\d+) s to settle, then (\d+) s of", (optimise.SETTLE, optimise.MEASURE)),
    ("how_to/optimisation", r"`--generations (\d+)`", optimise.GENERATIONS),
    ("how_to/optimisation", r"default: (\d+) generations of", description.Optimisation.generations),
    ("how_to/optimisation", r"several steps, (\d+) s apart", protocol.STAGE_TIME),
    ("how_to/optimisation", r"fewer than (\d+) breaths", costs.CART_SAMPLES),
    ("how_to/optimisation", r"response lags by (\d+) s", metabolic.TIME_CONSTANT),
    ("how_to/optimisation", r"--time-constant (\d+)`", metabolic.TIME_CONSTANT),
    ("how_to/notebooks", r"the (third) time the process is killed", own_process.KILLING_INTERRUPT),
    ("how_to/plotjuggler", r"Enter port (\d+)", PORT),
    ("how_to/plotjuggler", r"address that the block sends to, port (\d+)", PORT),
    ("how_to/plotjuggler", r"`\[::1\]:(\d+)`", PORT),
    ("how_to/plotjuggler", r"reads new samples every (\d+) ms", writer.POLL_PERIOD),
    ("how_to/rerun", r"listens on port (\d+)", default(Rerun, "port")),
    ("how_to/rerun", r"buffers\sup to (\d+) MB", rerun.QUEUE_LIMIT / 2**20),
    ("how_to/start_at_boot", r"`hold button.on for (\d+) s to arm`", safe("ARM_HOLD")),
    ("how_to/start_at_boot", r"holds the button for (\d+) s", safe("ARM_HOLD")),
    ("how_to/tuning", r"settings of one command, up to (\d+),", CHANGE_LIMIT),
    ("reference/actuators", r"its age and two rounds of (\d+) ms", safe("STOP_DAMP_ROUND") * MS),
    ("reference/actuators", r"`max_acceleration` of the joint \((\d+) rad/s²", default(CubeMars, "max_acceleration")),
    ("reference/actuators", r"guardian's stop, (\d+) ms at", STALL + safe("GUARDIAN_LOOK_PERIOD") * MS),
    ("reference/actuators", r"board reports at 1 to (\d+) Hz", CubeMarsV3.parameters["report_rate"].max),
    ("reference/actuators", r"current of `limit`, at most (\d+) A", servo.CURRENT),
    ("reference/actuators", r"`velocity_limit`; ([\d ]+) electrical", servo.SPEED),
    ("reference/actuators", r"\| ± (\d+)° of the motor, the range", math.degrees(servo.POSITION)),
    ("reference/actuators", r"`duty_limit`, ([\d.]+)", default(CubeMarsServo, "duty_limit")),
    ("reference/actuators", r"current of at most ([\d.]+) % of the rated", safe("STOP_REST_TORQUE", 10)),
    ("reference/actuators", r"the current must stay there for (\d+) ms", safe("STOP_REST") * MS),
    ("reference/actuators", r"is reported after (\d+) ms", safe("STOP_LIMIT") * MS),
    ("reference/actuators", r"Arming writes `can_timeout`,\s([\d.]+) s", default(RobStride, "can_timeout")),
    ("reference/actuators", r"at rest for ([\d.]+) s, before the table", safe("ZERO_REST")),
    ("reference/actuators", r"stayed within ([\d.]+) rad for ([\d.]+) s", (safe("ZERO_BAND", 1000), safe("ZERO_REST"))),
    ("reference/actuators", r"then fade in over ([\d.]+) s", safe("FADE_IN")),
    ("reference/actuators", r"position within ([\d.]+) rad of zero", safe("ZERO_BAND", 1000)),
    ("reference/actuators", r"silence of up to (\d+) s", safe("ZERO_LIMIT")),
    ("reference/actuators", r"at most (-\d+) °C, which", safe("TEMPERATURE_MINIMUM", 1)),
    ("reference/actuators", r"any span of replies up to (\d+) ms", safe("ACCELERATION_WINDOW") * MS),
    ("reference/actuators", r"they return over (\d+) ms", safe("ACCELERATION_GAINS_RETURN") * MS),
    ("reference/actuators", r"More than (\d+) ms of such acceleration", safe("ACCELERATION_FAULT") * MS),
    ("reference/actuators", r"allowed for, up to ([\d.]+) rad/s", safe("ACCELERATION_NOISE_LIMIT", 1000)),
    (
        "reference/actuators",
        r"`limit` plus (\d+) % of the peak torque, for (\d+) ms",
        (safe("TORQUE_ACCURACY", 1), safe("EXCESS_TORQUE") * MS),
    ),
    ("reference/actuators", r"is more than ([\d.]+) rad outside its `range`", safe("TRAVEL_MARGIN", 1000)),
    ("reference/actuators", r"faster than `max_velocity` in (\w+) replies", safe("OVERSPEED_REPLIES", 1)),
    ("reference/actuators", r"is less than (\d+) % of the law", safe("FOLLOWING_MEASURED", 1)),
    (
        "reference/actuators",
        r"more than (\d+) % of the rated torque for (\d+) ms",
        (safe("UNCOMMANDED_TORQUE_LIMIT", 1), safe("UNCOMMANDED_TORQUE_TIME") * MS),
    ),
    ("reference/actuators", r"over (\d+) s of\smotion the reported", safe("SCALE_TIME")),
    ("reference/actuators", r"`max_transit`, (\d+) ms", default(CubeMars, "max_transit") * MS),
    (
        "reference/actuators",
        r"`restart_time`, (\d+) ms, and of (\w+) periods",
        (default(CubeMarsV3, "restart_time") * MS, safe("RESTART_PERIODS", 1)),
    ),
    ("reference/actuators", r"is detected from (\d+) % on", safe("SCALE_TOLERANCE_WIRE_TORQUE", 1)),
    ("reference/networks", r"`inference_time`, (\d+) ms", default(OnnxModel, "inference_time") * MS),
    ("reference/networks", r"`stale` \(([\d.]+) s\)", default(OnnxModel, "stale")),
    ("reference/rate", r"real-time priority of (\d+), below", priority.PRIORITY),
    ("reference/recordings", r"chunks of about (\d+) MiB", mcap_file.CHUNK / 2**20),
    ("reference/recordings", r"shorter than ([\d.]+) s or longer than (\d+) s", STRIDES),
    ("reference/recordings", r"at most (six) plots of (twelve) signals", (grouping.PLOTS, grouping.CURVES)),
    ("reference/recordings", r"flushes every ([\d.]+) s", writer.FLUSH_PERIOD),
    ("reference/recordings", r"every process is killed \| ([\d.]+) s", writer.FLUSH_PERIOD + writer.POLL_PERIOD / 1e3),
    (
        "reference/recordings",
        r"s, which are (\d+) ticks at 200 Hz",
        (writer.FLUSH_PERIOD + writer.POLL_PERIOD / 1e3) * 200,
    ),
    ("reference/safe_stop", r"five periods and\s+at least (\d+) ms", STALL),
    (
        "reference/emergency_stop",
        r"detects a stalled run \((\d+) ms or (\d+) periods\)",
        (STALL, safe("LOOP_STALL_PERIODS", 1)),
    ),
    ("reference/safe_stop", r"silent for (\d+) ms, the run ends as a fault", safe("GUARDIAN_SILENCE") * MS),
    ("reference/safe_stop", r"sends nothing for ([\d.]+) s, the old process", handover.SILENCE * 1e-9),
    ("reference/safe_stop", r"The silence is (\d+) ms for a guardian", safe("GUARDIAN_SILENCE_REALTIME") * MS),
    ("reference/arming", r"`warning_temperature` \((\d+) °C\)", default(CubeMars, "warning_temperature")),
    ("reference/arming", r"torque of more than (\d+) % of\sthe rated", safe("UNCOMMANDED_TORQUE_LIMIT", 1)),
    ("reference/arming", r"has been true for (\d+) s, after it was", safe("ARM_HOLD")),
    ("reference/rigs", r"all pending frames, (\d+) at most", wires.FRAMES_AT_ONCE),
    ("reference/rigs", r"is counted; after (\w+) ticks in a row", safe("TX_QUEUE_FULL_LIMIT", 1)),
    ("reference/safe_stop", r"is at most ([\d.]+) % of the rated torque, plus", safe("STOP_REST_TORQUE", 10)),
    ("reference/safe_stop", r"as long as the replies need, at most (\d+) ms", safe("STOP_LISTEN_LIMIT") * MS),
    ("reference/arming", r"not confirmed after (\d+) ms", safe("STOP_LIMIT") * MS),
    ("reference/safe_stop", r"not confirmed after (\d+) ms", safe("STOP_LIMIT") * MS),
    ("reference/safe_stop", r"first every (\d+) ms and then", safe("STOP_ROUND") * MS),
    ("reference/safe_stop", r"rate, down to (\w+) times a second", 1 / safe("STOP_ROUND_MAXIMUM")),
    ("reference/safe_stop", r"without a terminal after (\d+) s", safe("STOP_UNATTENDED", 1)),
    ("reference/safe_stop", r"continues for at most (\d+) s", safe("STOP_ORPHANED", 1)),
    (
        "reference/safe_stop",
        r"\| (three) periods, at least (\d+) ms",
        (safe("HANG_PERIODS", 1), safe("HANG_MINIMUM") * MS),
    ),
    ("reference/safe_stop", r"\| (five) periods, at least (\d+) ms", (safe("LOOP_STALL_PERIODS", 1), STALL)),
    ("reference/emergency_stop", r"standard id (0x[\dA-F]+) \(`can_id`\)", default(EStopHeartbeat, "can_id")),
    (
        "reference/emergency_stop",
        r"Silence for `timeout` \(([\d.]+) s by default\)",
        default(EStopHeartbeat, "timeout"),
    ),
    ("reference/arming", r"commands that fade in over ([\d.]+) s \|", safe("FADE_IN")),
    ("reference/running", r"at most (\w+) times\sand never twice", process.RESTART_LIMIT),
    ("reference/running", r"the first (\d+) ms of the safe stop", safe("STOP_LIMIT") * MS),
    ("reference/running", r"status line is updated (\w+) times per second", 1 / status.REFRESH_PERIOD),
    ("reference/running", r"`stop_time` seconds \(at most (\d+)\)", CubeMars.parameters["stop_time"].max),
    ("reference/sensors", r"--plotjuggler 127.0.0.1:(\d+)", PORT),
    ("reference/i2c", r"--plotjuggler 127.0.0.1:(\d+)", PORT),
    ("reference/imus", r"source address \((\d+) by default\)", default(OpenImu, "address")),
    ("reference/imus", r"arrive at up to (\d+) Hz", max(OpenImu.parameters["rate"].choices)),
    ("reference/imus", r"delivered with (\d+) kbit/s", default(OpenImu, "bitrate") / 1e3),
    ("reference/i2c", r"lost, and retried every (\d+) ms", RETRY),
    ("reference/i2c", r"After (\w+) failures in a row it is lost", native("lines/i2c.pyx", "FAILURE_LIMIT")),
    ("reference/i2c", r"(Ten) times per second, an IMU's settings", 1e3 / CHECK),
    ("reference/i2c", r"`timeout` \(([\d.]+) s for an IMU\)", default(MPU9250, "timeout")),
    ("reference/imus", r"at rest, (\d+) s at least", fits.MIN_REST_TIME),
    ("reference/imus", r"up and down within (\d+)°", math.degrees(math.acos(stillness.FACE_COSINE))),
    ("reference/imus", r"gravity is ([\d.]+) m/s² in all", fits.G),
    ("reference/imus", r"from (twelve) positions on a symmetric", fits.SYMMETRIC_FIT_POSITIONS),
    ("reference/tools", r"--plotjuggler 127.0.0.1:(\d+)", PORT),
    ("reference/versions", r"CPython 3\.(\d+) to 3\.(\d+) on Linux", PYTHONS),
    ("reference/versions", r"with glibc 2\.(\d+) or newer", GLIBC),
    ("../README", r"CPython 3\.(\d+) to 3\.(\d+)", PYTHONS),
    ("CONTRIBUTING", r"every CPython from 3\.(\d+) to 3\.(\d+)", TRIED_PYTHONS),
    ("CONTRIBUTING", r"for glibc 2\.(\d+) or newer", GLIBC),
    ("tutorial/4_rig", r"timeout \(([\d.]+) s\)", default(CubeMars, "timeout")),
]
WORDS = {"two": 2, "three": 3, "third": 3, "five": 5, "six": 6, "ten": 10, "twelve": 12}
NAMED = re.compile(r"`(\w+)`,? \(?(-?\d[\d.]*) (ms|s|%|Hz|rad/s²|rad/s|rad|°C|N·m)(?![\w/·²])")
FACTORS = {"ms": 1e-3, "%": 1e-2}


def number(text):
    text = text.replace(" ", "").replace("−", "-").lower()
    return float(WORDS.get(text) or (int(text, 16) if text.startswith("0x") else text))


@pytest.mark.parametrize("page, pattern, value", PRINTED)
def test_a_printed_number_is_that_of_the_code(page, pattern, value):
    found = re.findall(pattern, " ".join((ROOT / "docs" / f"{page}.md").read_text().split()))
    values = value if isinstance(value, tuple) else (value,)
    assert found
    for numbers in found:
        printed = [number(text) for text in (numbers if isinstance(numbers, tuple) else (numbers,))]
        assert printed == pytest.approx([float(each) for each in values], rel=1e-9), pattern


@pytest.mark.parametrize("page", NAMES)
def test_a_number_behind_the_name_of_a_parameter_is_its_default(page):
    text = re.sub(r"^```.*?^```", "", (ROOT / page).read_text(), flags=re.DOTALL | re.MULTILINE)
    for name, value, unit in NAMED.findall(text):
        defaults = [kind.parameters[name].default for kind in homes() if name in kind.parameters]
        printed = float(value) * FACTORS.get(unit, 1.0)
        assert not defaults or any(own == pytest.approx(printed) for own in defaults), (name, value, unit)


@pytest.mark.parametrize("page", ["how_to/blocks", "how_to/tuning"])
def test_the_pages_state_the_time_of_a_ramp(page):
    assert RAMP_TIME == 1.0 and re.search(r"range in\s+one\s+second", (ROOT / "docs" / f"{page}.md").read_text())


def test_the_page_of_running_lists_the_exit_codes_of_the_code():
    text = (ROOT / "docs" / "reference" / "running.md").read_text()
    codes = {int(code) for code in re.findall(r"^\| (\d+) \|", text[text.index("| exit code |") :], re.MULTILINE)}
    own = {value for name, value in vars(errors).items() if name.isupper() and type(value) is int}
    assert own <= codes, own - codes


def test_the_docstring_of_the_conformance_test_numbers_its_checks():
    assert len(re.findall(r"^\d+\. ", inspect.getdoc(check_block), re.MULTILINE)) == 10


@pytest.mark.parametrize(
    "page",
    ["README.md", "CITATION.cff", "docs/index.md", "docs/coming_from/epically_powerful.md", "docs/hardware/index.md"],
)
def test_the_paper_is_cited_with_its_title_and_number(page):
    text = " ".join((ROOT / page).read_text().split())
    title = "Epically Powerful: An open-source software and mechatronics infrastructure for wearable robotic systems"
    assert title in text and "2511.05033" in text


def test_the_citation_has_the_version_of_the_package():
    version = re.search(r'^version = "(.*)"', PYPROJECT, re.MULTILINE)[1]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text()
