"""Every test of this folder runs twice, fused and with calls of the kernels; those that measure time run fused."""

import pytest

from cext.fused import library


@pytest.fixture(scope="module", autouse=True)
def machine_code(request):
    """Whether programs are fused, here and in child processes."""
    if getattr(request, "param", "fused") == "fused":
        yield
        return
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TICKWORK_FUSED", "0")
        patch.setattr(library, "opened", lambda: (None, "TICKWORK_FUSED=0 in the environment"))
        yield


def pytest_generate_tests(metafunc):
    marks = [mark.name for mark in metafunc.definition.iter_markers()]
    if "timing" not in marks:
        metafunc.parametrize("machine_code", ["fused", "called"], indirect=True, scope="module")
