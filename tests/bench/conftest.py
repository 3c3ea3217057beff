"""The commands, called in this process from an empty folder."""

import pytest

from tests.bench.__main__ import main
from tests.runtime.conftest import forked_children  # noqa: F401


@pytest.fixture
def bench(tmp_path, monkeypatch, capsys):
    """Function of the words of a command that returns (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        capsys.readouterr()
        code = main([str(word) for word in words])
        return code, *capsys.readouterr()

    return run
