"""Frames that other implementations made or read, compared with ours; each source with the tolerance it deserves, and
why.

The vectors stand in the shared room, ../shared/vectors or $TICKWORK_SHARED/vectors, and are no part of the project's
tree: without them these tests are skipped. A code below is the whole number that a field carries; ours is truncated x
(2ⁿ − 1) / span.

    dfki                     the same convention: equal
    Epically Powerful, TM    2ⁿ instead of 2ⁿ − 1, and the input clamped two codes below the top: ours or one above, one
    below at the top LR, the manual's text    2ⁿ without that clamp: ours or one above; the top wraps to 0, and its
    carry is or-ed into the field before

Libraries that use other ranges than the manual are asked in their own: x is scaled by the ratio of the ranges before we
encode it.
"""

import math

import pytest

from blocks.actuators import CubeMars, EmulatedCubeMars
from blocks.actuators.cubemars.models import AMBIGUOUS, MODELS
from blocks.actuators.mit_frames import DISABLE, ENABLE, SET_ZERO
from blocks.actuators.sources import with_ranges
from tests.blocks.actuators import reference
from tests.blocks.actuators.wire import NOT_FINITE, OUT_OF_LIMITS, TAKEN, Wired
from tests.shared import entries, specifications

INPUTS = {
    "position": "position_rad",
    "velocity": "velocity_rad_s",
    "stiffness": "kp",
    "damping": "kd",
    "torque": "torque_nm",
}
LIMITS = {"position": "p", "velocity": "v", "stiffness": "kp", "damping": "kd", "torque": "t"}
BEFORE = {"velocity": "position", "stiffness": "velocity", "damping": "stiffness", "torque": "damping"}

# What dfki's library has for each of its models: half ranges of position, velocity and torque, and the sign it turns
# every value by.
DFKI = {
    "AK10_9_V1p1": (12.5, 50.0, 65.0, -1),
    "AK70_10_V1p1": (12.5, 50.0, 24.0, 1),
    "AK80_6_V1": (95.5, 45.0, 18.0, -1),
    "AK80_6_V1p1": (12.5, 22.5, 12.0, -1),
    "AK80_6_V2": (12.5, 76.0, 12.0, 1),
    "AK80_9_V1p1": (12.5, 22.5, 18.0, 1),
    "AK80_9_V2": (12.5, 25.64, 18.0, 1),
}


def ours(family):
    """Our model for the name of a motor that other libraries use."""
    return with_ranges(MODELS[AMBIGUOUS.get(family, family)], "manual" if family == "AK40-10" else "")


def library(source):
    marks = {
        "dfki": "mini-cheetah",
        "EP": "epicallypowerful",
        "TM": "TMotorCANControl",
        "LR": "leggedrobotics",
        "AKM": "CubeMars",
    }
    for name, mark in marks.items():
        if source.startswith(mark):
            return name
    raise ValueError(f"nothing is known of {source}")


def of(source, name):
    found = [entry for entry in entries(name) if library(entry["source"]) == source]
    assert found, f"no frame of {source}"
    return found


def half_ranges(model):
    return {
        "position": 12.5,
        "velocity": model.wire_velocity,
        "stiffness": 500.0,
        "damping": 5.0,
        "torque": model.wire_torque,
    }


@pytest.fixture(scope="module")
def drives():
    """Drives by model and direction, with limits as wide as the wire."""
    made = {}

    def drive(model, invert=False):
        if (model, invert) not in made:
            ranges = "manual" if model.name == "AK40-10" else ""
            made[model, invert] = Wired(CubeMars, model.name, can_id=1, invert=invert, ranges=ranges, errors="code")
            made[model, invert]["limits"] = [*made[model, invert]["wire"], math.inf, 1.0]
        return made[model, invert]

    return drive


def compared(entry, drives):
    """(theirs, ours) by field as codes, the ranges in which the commands agree, and the fields that asked for the top
    or more.

    What they ask beyond their range they clamp; we would refuse it, and are given the end instead.
    """
    limits, model = entry["limits"], ours(entry["model_family"])
    their_half = {name: limits[key] for name, key in LIMITS.items()}
    our_half = half_ranges(model)
    wired = drives(model, invert=entry.get("axis_direction", 1) < 0)
    asked, at_top = {}, set()
    for name, key in INPUTS.items():
        share = entry["inputs"][key] / their_half[name]
        low = 0.0 if name in ("stiffness", "damping") else -1.0
        asked[f"{name}_command"] = min(max(share, low), 1.0) * our_half[name]
        if share >= 1.0:
            at_top.add(name)
        if share > 1.0 or share < low:
            assert (
                wired.say(**{**dict.fromkeys(wired.block.inputs, 0.0), f"{name}_command": share * our_half[name]})
                == OUT_OF_LIMITS
            )
    ((identifier, data),) = wired.say(**asked)
    assert identifier == entry["frame"]["arbitration_id"] and not entry["frame"]["is_extended"]
    return reference.codes_of(bytes.fromhex(entry["frame"]["data_hex"])), reference.codes_of(data), at_top


def test_dfki_implementation_sends_the_same_bytes(drives):
    """Equal, mirrored where the library mirrors. Where the ranges differ, scaling may round to the neighbouring
    code.
    """
    for entry in of("dfki", "cubemars_mit_command"):
        theirs, mine, _ = compared(entry, drives)
        limits, half = entry["limits"], half_ranges(ours(entry["model_family"]))
        for name, key in LIMITS.items():
            assert abs(theirs[name] - mine[name]) <= (limits[key] != half[name]), (name, entry)


@pytest.mark.parametrize("source", ["EP", "TM"])
def test_libraries_that_clamp_below_the_top_are_at_most_one_code_off(drives, source):
    for entry in of(source, "cubemars_mit_command"):
        theirs, mine, at_top = compared(entry, drives)
        for name in INPUTS:
            assert theirs[name] - mine[name] in ((-1,) if name in at_top else (0, 1)), (name, entry)


@pytest.mark.parametrize("source", ["LR", "AKM"])
def test_manual_formula_differs_by_one_code_and_wraps_at_top(drives, source):
    for entry in of(source, "cubemars_mit_command"):
        theirs, mine, at_top = compared(entry, drives)
        for name, bits in reference.FIELDS:
            if name in at_top:
                assert mine[name] == 2**bits - 1 and theirs[name] in (0, 1), (name, entry)
            else:
                carried = any(BEFORE.get(top) == name for top in at_top - {"velocity", "damping"})
                assert theirs[name] - mine[name] in ((0, 1, 2) if carried else (0, 1)), (name, entry)


def test_enable_disable_and_zero_frames_equal_other_implementations():
    special = {"enter": ENABLE, "exit": DISABLE, "zero": SET_ZERO}
    for entry in entries("cubemars_mit_special"):
        wanted = (
            bytes.fromhex(entry["frame"]["data_hex"]),
            entry["frame"]["arbitration_id"],
            entry["frame"]["is_extended"],
        )
        assert (special[entry["inputs"]["command"]], entry["inputs"]["can_id"], False) == wanted


def stated(entry):
    """Half ranges of position, velocity, torque, and the sign, that the source of a reading has for the model."""
    source, model = library(entry["source"]), ours(entry["model_family"])
    if source == "dfki":
        *half, sign = DFKI[entry["model"]]
        return half, sign
    if source == "EP":
        return [12.5, *specifications("cubemars_mit_v1v2")["epicallypowerful_uses"][entry["model"]]], 1
    if source == "TM" and entry["model_family"] == "AK60-6":
        return [12.5, 50.0, 15.0], 1
    return [12.5, model.wire_velocity, model.wire_torque], 1


@pytest.mark.parametrize(
    "source, tolerance", [("dfki", 1e-12), ("EP", 1e-12), ("TM", 1e-12), ("AKM", 1e-12), ("LR", 2e-7)]
)
def test_replies_are_decoded_as_by_other_implementations(drives, source, tolerance):
    """In shares of the range, as libraries differ in ranges: 1e-12 for doubles, 2e-7 for LR, which computes in single
    precision.
    """
    for entry in of(source, "cubemars_mit_feedback"):
        model, decoded = ours(entry["model_family"]), entry["decoded"]
        half, sign = stated(entry)
        wired = drives(model, invert=sign < 0)
        assert wired.hear(entry["frame"]["arbitration_id"], bytes.fromhex(entry["frame"]["data_hex"])) == TAKEN
        own = (12.5, model.wire_velocity, model.wire_torque)
        for name, key, theirs, mine in zip(
            ("position", "velocity", "torque"), ("position_rad", "velocity_rad_s", "torque_nm"), half, own
        ):
            assert abs(decoded[key] / theirs - wired[name] / mine) < tolerance, (name, entry)
        if decoded["temperature_c"] is not None:  # TM hands out the byte as it is, without taking 40 °C away
            assert decoded["temperature_c"] == wired["temperature"] + (40.0 if source == "TM" else 0.0)
        if decoded["fault"] is not None:
            assert decoded["fault"] == wired["fault"] == entry["raw"]["err"]


def test_the_emulated_drive_decodes_commands_like_mit_firmware():
    """The compiled firmware decodes in single precision: 2e-7 of the range."""
    drives = {}
    for entry in entries("mit_command_as_seen_by_firmware"):
        model = ours(entry["model"])
        wired = drives.setdefault(model, Wired(EmulatedCubeMars, model.name, can_id=1))
        assert wired.hear(1, ENABLE) == TAKEN and wired.hear(1, bytes.fromhex(entry["frame"]["data_hex"])) == TAKEN
        position, velocity, stiffness, damping, torque = wired["command"]
        understood = {
            "position": position,
            "velocity": velocity,
            "stiffness": stiffness,
            "damping": damping,
            "torque": torque,
        }
        for name, half in half_ranges(model).items():
            assert abs(entry["decoded"][INPUTS[name]] - understood[name]) < 2e-7 * half, (name, entry)


def test_the_emulated_drive_replies_like_mit_firmware():
    """Six bytes are common to both, then comes a voltage there, temperature and error here: equal."""
    for entry in entries("mit_reply_encode_katz"):
        model, given = ours(entry["model"]), entry["inputs"]
        ranges = "manual" if model.name == "AK40-10" else ""
        wired = Wired(EmulatedCubeMars, model.name, can_id=given["id"], peak=model.wire_torque, ranges=ranges)
        wired.hear(given["id"], ENABLE)
        wired["command"] = (0.0, 0.0, 0.0, 0.0, given["torque_nm"])
        ((identifier, data),) = wired.say(position=given["position_rad"], velocity=given["velocity_rad_s"])
        assert data[:6].hex() == entry["frame"]["data_hex"], entry
        assert identifier == given["id"], (
            "as the manual says; the firmware of MIT answers from id 0, and we accept both"
        )


def test_non_finite_command_is_refused_unlike_reference_implementations(drives):
    names = {"AK80-9", "AK80_9_V1p1", "AK80-9 V3", "AK80-9-V3", "AK80-9 servo", "RS02"}
    tried = 0
    for entry in entries("nonfinite_inputs"):
        assert entry["model"] in names
        fields = {f"{name}_command": float(entry["inputs"][key]) for name, key in INPUTS.items()}
        assert not all(map(math.isfinite, fields.values()))
        wired = drives(MODELS["AK80-9"])
        wired.frames[0].length = 0
        assert wired.say(**fields) == NOT_FINITE and wired.frames[0].length == 0
        tried += 1
    assert tried
