"""No crash, no hang, nothing out of bounds, no wrong checksum believed, every good packet found: a fuzzer looks, guided
by coverage.

`make soak` gives each parser some seconds, TICKWORK_FUZZ_SECONDS more. What it finds is kept in build/fuzzing, and
begun with next time.
"""

import os

import pytest

from tests.checkout import ROOT
from tests.fuzzing.laboratory import Laboratory, why_not
from tests.fuzzing.targets import EVERYTHING, TARGETS, kernels, kernels_of, modules_of

SECONDS = float(os.environ.get("TICKWORK_FUZZ_SECONDS", 5))

soak = pytest.mark.soak
needs_clang = pytest.mark.skipif(bool(why_not()), reason=why_not())


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory):
    return Laboratory(tmp_path_factory.mktemp("fuzzing") / "copy")


def test_every_decode_and_encode_has_a_target():
    """A kernel that is added or moved is fuzzed, or this fails, also on a machine without a fuzzer."""
    driven = {place for name in TARGETS for place in kernels_of(name)}
    assert [kernel for place, kernel in kernels().items() if place not in driven] == []
    assert all((ROOT / f"{module}.pyx").is_file() for name in EVERYTHING for module in modules_of(name))


@soak
@needs_clang
@pytest.mark.parametrize("name", EVERYTHING)
def test_no_input_crashes_a_parser(name, laboratory, capsys):
    run = laboratory.fuzzed(name, SECONDS)
    with capsys.disabled():
        print("\n" + run.in_words(), end="")
    assert not run.failure, run.said[-6000:]
    assert run.executions > 100 and run.edges > 0, run.said[-6000:]


@soak
@needs_clang
@pytest.mark.parametrize(
    ("name", "file", "before", "after", "told"),
    [
        (
            "microstrain",
            "cext/kernels/devices/microstrain/mip.pxd",
            "== (<uint16_t>found[need - 2] << 8 | found[need - 1])",
            ">> 8 == found[need - 2]",
            "another number",
        ),
        (
            "microstrain",
            "cext/kernels/devices/microstrain/mip.pxd",
            "        corrupt[0] += 1\n        at[0] += 1",
            "        corrupt[0] += 1\n        at[0] += need",
            "another number",
        ),
        (
            "lines",
            "cext/kernels/devices/microcontroller.pyx",
            "(LINE if lines else PACKET_LIMIT) - 1",
            "(LINE if lines else PACKET_LIMIT) + 8",
            "AddressSanitizer",
        ),
        (
            "gpio",
            "cext/kernels/devices/gpio.pyx",
            "<uint32_t><int64_t>state[0]",
            "<uint32_t>state[0]",
            "outside the range",
        ),
        (
            "openimu",
            "cext/kernels/devices/openimu/frames.pyx",
            "if frame.length != 8:",
            "if frame.length > 8:",
            "behind the end of a frame",
        ),
        (
            "reads",
            "cext/lines/streams.pyx",
            "FRAME_BYTES // source.record * source.record",
            "(FRAME_BYTES - 1) // source.record * source.record",
            "as long as what was read",
        ),
    ],
)
def test_a_planted_error_is_detected(name, file, before, after, told, laboratory):
    """A checksum of one byte, good packets lost to false headers, a buffer that is too small, a cast, and bytes that
    are none of a frame.
    """
    run = laboratory.with_error(file, before, after, name, 60.0)
    assert told in run.failure, (run.failure, run.said[-3000:])
