"""Frames that other implementations made or read, compared with ours; each source with the tolerance it deserves, and
why.

The vectors stand in the shared room, ../shared/vectors or $TICKWORK_SHARED/vectors, and are no part of the project's
tree: without them these tests are skipped. A code below is the whole number that a field carries; ours is truncated x
65535 / span.

    manual               the same formula in single precision: at most one code off
    Epically Powerful    truncated too: at most one; but stiffness and damping of RS03, RS04, RS06 have ranges of 500
    and 5 there robstride_dynamics   (x / r + 1) 32767 instead of 65535 / 2: at most two; ranges of its own, in which it
    is asked the vendor's C++     positions of ± 12.5: asked in its own range; single precision: at most one
    pycybergear, Tony    the same codes, at most one off; the first leaves torque out, the second has its bytes the
    wrong way round
"""

import math
import struct

import pytest

from blocks.actuators import RobStride, RobStrideMIT, mit_frames
from blocks.actuators.robstride import frames, mit
from blocks.actuators.robstride.models import MODELS
from tests.blocks.actuators import reference as mit_reference
from tests.blocks.actuators import robstride_reference as reference
from tests.blocks.actuators.wire import EXTENDED, IDLE, NOT_FINITE, TAKEN, Wired
from tests.shared import entries, specifications

INPUTS = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "stiffness": "kp",
    "damping": "kd",
    "torque": "torque_nm",
}
LIMITS = {"position": "p", "velocity": "v", "stiffness": "kp", "damping": "kd", "torque": "t"}
SOURCES = {
    "EP": "epicallypowerful",
    "manual": "RobStride user manual",
    "RD": "robstride_dynamics",
    "RSV": "RobStride/SampleProgram",
    "PCG": "pycybergear",
    "TONY": "Tony607",
    "RP": "robstride(PyPI",
}


def of(source, name):
    found = [entry for entry in entries(name) if entry["source"].lower().startswith(SOURCES[source].lower()[:20])]
    assert found, f"no frame of {source}"
    return found


@pytest.fixture(scope="module")
def drives():
    """Drives by model, with limits as wide as the wire."""
    made = {}

    def drive(model, host_id=0xFD):
        if (model, host_id) not in made:
            made[model, host_id] = Wired(RobStride, model, host_id=host_id)
            made[model, host_id]["limits"] = [*made[model, host_id]["wire"], math.inf, 1.0]
        return made[model, host_id]

    return drive


def compared(entry, drives):
    """(theirs, ours) as codes. They are asked in their own ranges, and clamped there; ours is given the same share of
    its range.
    """
    found, asked = MODELS[entry["model"]], {}
    for name, key in INPUTS.items():
        share = entry["inputs"][key] / entry["limits"][LIMITS[name]]
        low = 0.0 if name in ("stiffness", "damping") else -1.0
        asked[f"{name}_command"] = min(max(share, low), 1.0) * getattr(found, f"wire_{name}")
    (mine,) = drives(entry["model"]).say(**asked)
    theirs = entry["frame"]["arbitration_id"] | EXTENDED, bytes.fromhex(entry["frame"]["data_hex"])
    assert entry["frame"]["is_extended"] and theirs[0] & 255 == 127 == mine[0] & 255
    return reference.codes_of(theirs), reference.codes_of(mine)


def within(entry):
    """Whether the command is inside its ranges: some libraries do not clamp, and wrap."""
    low = {"kp": 0.0, "kd": 0.0}
    most = {key: entry["limits"][LIMITS[name]] for name, key in INPUTS.items()}
    return all(low.get(key, -limit) <= entry["inputs"][key] <= limit for key, limit in most.items())


@pytest.mark.parametrize("source, tolerance", [("manual", 1), ("EP", 1), ("RSV", 1), ("RD", 2)])
def test_reference_implementations_send_same_codes_in_their_ranges(drives, source, tolerance):
    for entry in of(source, "robstride_operation_command"):
        theirs, mine = compared(entry, drives)
        for name in INPUTS:
            assert abs(theirs[name] - mine[name]) <= tolerance, (name, entry)


def test_encoded_ranges_equal_the_manuals():
    for entry in of("manual", "robstride_operation_command"):
        found = MODELS[entry["model"]]
        assert all(entry["limits"][key] == getattr(found, f"wire_{name}") for name, key in LIMITS.items()), entry


def test_stiffness_and_damping_of_the_large_models_follow_the_manual_and_not_epically_powerful():
    """Its frame encodes ten times the requested stiffness and twenty times the damping."""
    theirs = {entry["model"]: entry["limits"]["kp"] for entry in of("EP", "robstride_operation_command")}
    wrong = {model for model, stiffness in theirs.items() if stiffness != MODELS[model].wire_stiffness}
    assert wrong == {"RS03", "RS04", "RS06"}
    assert all((MODELS[name].wire_stiffness, MODELS[name].wire_damping) == (5000.0, 100.0) for name in wrong)


def test_pycybergear_sends_its_host_id_in_the_torque_field(drives):
    for entry in of("PCG", "robstride_operation_command"):
        theirs, mine = compared(entry, drives)
        if within(entry):
            assert all(
                abs(theirs[name] - mine[name]) <= 1 for name in ("position", "velocity", "stiffness", "damping")
            ), entry
        assert theirs["torque"] <= 255, "full torque backwards, whatever was asked"


def test_tonys_implementation_swaps_the_bytes_of_each_field(drives):
    for entry in of("TONY", "robstride_operation_command"):
        if within(entry):
            theirs, mine = compared(entry, drives)
            swapped = {
                name: code if name == "torque" else code >> 8 | (code & 255) << 8 for name, code in theirs.items()
            }
            assert all(abs(swapped[name] - mine[name]) <= 1 for name in INPUTS), entry


@pytest.mark.parametrize(
    "source, tolerance", [("manual", 1e-12), ("EP", 1e-12), ("PCG", 1e-12), ("RD", 4e-5), ("RSV", 1e-6), ("RP", 1e-12)]
)
def test_replies_are_decoded_as_by_other_implementations(drives, source, tolerance):
    """In shares of the range, as libraries differ in ranges. RSV is single precision, RD has 0x7FFF where 65535 / 2
    belongs.
    """
    pi = 4.0 * math.pi
    dynamics = {"RS00": (50, 17), "RS03": (50, 60), "RS05": (33, 17), "RS06": (20, 60)}
    half = {
        "RSV": lambda m: (12.5, m.wire_velocity, m.wire_torque),
        "RP": lambda m: (pi, m.wire_velocity, m.wire_torque),
        "RD": lambda m: (pi, *dynamics.get(m.name, (m.wire_velocity, m.wire_torque))),
    }
    mark = "RobStride manual" if source == "manual" else SOURCES[source]
    found = [entry for entry in entries("robstride_feedback") if entry["source"].startswith(mark)]
    assert found, f"no reading of {source}"
    for entry in found:
        model, decoded, raw = MODELS[entry["model"]], entry["decoded"], entry["raw"]
        host = entry["frame"]["arbitration_id"] & 255
        wired = Wired.again(drives(entry["model"], host))
        identifier, data = entry["frame"]["arbitration_id"], bytes.fromhex(entry["frame"]["data_hex"])
        runs = identifier >> 22 & 3 == 2
        assert wired.hear(identifier | EXTENDED, data) == (TAKEN if runs else IDLE)
        own = model.wire_position, model.wire_velocity, model.wire_torque
        theirs = half.get(source, lambda m: own)(model)
        for name, key, a, b in zip(
            ("position", "velocity", "torque"), ("position_rad", "velocity_rad_s", "torque_nm"), theirs, own
        ):
            assert abs(decoded[key] / a - wired[name] / b) < tolerance, (name, entry)
        assert abs(decoded["temperature_c"] - wired["temperature"]) < 1e-4 and wired["fault"] == raw["fault"]
        if "fault_bits" in decoded:
            assert decoded["fault_bits"] == raw["fault"]
        if "mode" in decoded and source != "RP":  # which masks one bit of two
            assert decoded["mode"] == raw["mode"] == entry["frame"]["arbitration_id"] >> 22 & 3


def test_frames_of_other_types_match_reference():
    """Those that we send, byte for byte; of the libraries that leave the host out, all but that."""
    made = 0
    for entry in entries("robstride_other_types"):
        asked, motor, host = entry["inputs"], entry["inputs"].get("motor_id", 127), entry["inputs"].get("host_id", 0xFD)
        first = entry["frame"] if "frame" in entry else entry["frames"][0]
        theirs = first["arbitration_id"], first["is_extended"], bytes.fromhex(first["data_hex"])
        words = asked["command"]
        if words.startswith("write param"):
            mine = frames.write(asked["index"], asked["value"], motor, host)
            if asked["index"] not in frames.WHOLE and asked.get("dtype", "float32") != "float32":
                continue  # zero_sta and EPScan_time, which we do not write
        elif words.startswith("enable"):
            mine = frames.frame(frames.ENABLE, theirs[0] >> 8 & 0xFFFF, motor)
        elif words.startswith("stop") and "clear" not in words:
            mine = frames.frame(frames.STOP, theirs[0] >> 8 & 0xFFFF, motor)
        elif words.startswith("active report"):
            mine = frames.reports(words.split()[2] == "on", motor, host)
        else:
            continue
        assert mine == theirs, entry
        made += 1
    assert made > 20


def test_fault_reports_are_decoded_as_listed_in_the_manual():
    for entry in entries("robstride_fault_type21"):
        wired = Wired(RobStride, "RS03")
        wired.hear(entry["frame"]["arbitration_id"] | EXTENDED, bytes.fromhex(entry["frame"]["data_hex"]))
        assert wired["fault"] == 256 << entry["decoded"]["bit"] and 8 + entry["decoded"]["bit"] in frames.FAULTS


def test_values_of_parameters_are_little_endian():
    for entry in entries("robstride_param_reply"):
        data, decoded = bytes.fromhex(entry["frame"]["data_hex"]), entry["decoded"]
        layout = {"B": "<Bxxx", "f": "<f"}.get(decoded["type"], f"<{decoded['type']}")
        written = frames.write(decoded["index"], decoded["value"], 127, 0xFD)[2]
        assert struct.unpack("<H", data[:2])[0] == decoded["index"]
        read = struct.unpack(layout, data[4 : 4 + struct.calcsize(layout)])[0]
        assert read == pytest.approx(decoded["value"], rel=1e-6)
        if decoded["type"] == "f" or decoded["index"] in frames.WHOLE:
            assert written == data, "what is read is what would be written"


def test_mit_frames_equal_the_vendors():
    """Its sample asks positions within ± 12.5 and clamps; single precision: at most one code off. Its FC with a mode
    chooses the mode.
    """
    wired = Wired(RobStrideMIT, "RS01", can_id=1, wire_position=12.5, limit="peak")
    wired["limits"] = [*wired["limits"][:5], math.inf, 1.0]
    half = dict(zip(INPUTS, wired["wire"]))
    seen = 0
    for entry in entries("robstride_mit_protocol"):
        if entry.get("direction") == "decode":
            assert wired.hear(entry["frame"]["arbitration_id"], bytes.fromhex(entry["frame"]["data_hex"])) == TAKEN
            for name, key in (("position", "position_rad"), ("velocity", "velocity_rad_s"), ("torque", "torque_nm")):
                assert abs(wired[name] - entry["decoded"][key]) < 1e-6 * half[name], entry
            assert abs(wired["temperature"] - entry["decoded"]["temperature_c"]) < 1e-4
        elif "kp" in entry["inputs"]:
            asked = {name: entry["inputs"][key] for name, key in INPUTS.items()}
            low = {name: 0.0 if name in ("stiffness", "damping") else -half[name] for name in half}
            ((identifier, data),) = wired.say(
                **{f"{name}_command": min(max(x, low[name]), half[name]) for name, x in asked.items()}
            )
            assert identifier == entry["frame"]["arbitration_id"] and not entry["frame"]["is_extended"]
            theirs, mine = (
                mit_reference.codes_of(bytes.fromhex(entry["frame"]["data_hex"])),
                mit_reference.codes_of(data),
            )
            assert all(abs(theirs[name] - mine[name]) <= 1 for name in half), entry
        elif "enable" in entry["inputs"]["command"]:
            assert bytes.fromhex(entry["frames"][0]["data_hex"]) == mit.ENABLE
        elif "disable" in entry["inputs"]["command"]:
            assert bytes.fromhex(entry["frames"][0]["data_hex"]) == mit.DISABLE
        elif "set zero" in entry["inputs"]["command"]:
            assert bytes.fromhex(entry["frames"][0]["data_hex"]) == mit_frames.SET_ZERO
        seen += 1
    assert seen > 40


def test_the_model_table_equals_the_specification():
    table = specifications("robstride")["models"]
    assert {name.split()[0] for name in table} == set(MODELS) - {"RS10P"}, "which is newer"
    for name, row in table.items():
        model = MODELS[name.split()[0]]
        assert (model.rated, model.peak, model.wire_torque, model.wire_velocity, model.wire_position) == (
            row["rated_nm"],
            row["peak_nm"],
            row["t"],
            row["v"],
            row["p"],
        ), name
        assert (model.wire_stiffness, model.wire_damping, model.rms_constant, model.no_load) == (
            row["kp"],
            row["kd"],
            row["kt_nm_per_arms"],
            row["noload_rpm"],
        ), name
        assert (model.rated_current, model.peak_current) == (row["rated_apk"], row["max_apk"]), name


def test_non_finite_command_is_refused_unlike_reference_implementations():
    tried = 0
    for entry in entries("nonfinite_inputs"):
        fields = {f"{name}_command": float(entry["inputs"][key]) for name, key in INPUTS.items()}
        for kind in (RobStride, RobStrideMIT):
            wired = Wired(kind, "RS02")
            assert wired.say(**fields) == NOT_FINITE and wired.frames[0].length == 0
        tried += 1
    assert tried
