"""Tests of this folder run twice, fused and with calls of the kernels. Those that measure time run fused, as do those
of devices, whose kernels are called in both, and those that run no program.
"""

import pytest

from cext.fused import library

ONCE = {  # modules and tests
    "test_devices",
    "test_enabling",
    "test_many_drives",
    "test_no_output_leaves_the_range_that_is_proved",
    "test_page_watch",
    "test_ready",
    "test_stop_values",
    "test_two_devices",
    "test_zeroing",
}


@pytest.fixture(scope="module", autouse=True)
def machine_code(request):
    """Whether programs are fused, here and in child processes."""
    if getattr(request, "param", "fused") == "fused":
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TICKWORK_FUSED", "0")
        patch.setattr(library, "open_library", lambda: (None, "TICKWORK_FUSED=0 in the environment"))
        yield


def pytest_generate_tests(metafunc):
    marks = [mark.name for mark in metafunc.definition.iter_markers()]
    names = {metafunc.module.__name__.rpartition(".")[2], metafunc.function.__name__}
    if "timing" not in marks and not names & ONCE:
        metafunc.parametrize("machine_code", ["fused", "called"], indirect=True, scope="module")
