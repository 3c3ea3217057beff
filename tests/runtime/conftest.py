"""The command line, called in this process: quick, for everything that ends before a robot would be armed."""

import os
import sys

import pytest

from runtime.cli.main import main
from runtime.host import child_process
from runtime.host.errors import BAD_INPUT
from tests.runtime.runs import FORKING, environment


@pytest.fixture(autouse=True)
def fresh_imports(request, monkeypatch):
    """Forget the modules that a test has imported from its own folder."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    if "tmp_path" not in request.fixturenames:
        yield
        return
    before, folder = {*sys.modules}, f"{request.getfixturevalue('tmp_path')}{os.sep}"
    yield
    for name in sys.modules.keys() - before:
        if (getattr(sys.modules[name], "__file__", None) or "").startswith(folder):
            del sys.modules[name]


@pytest.fixture(autouse=True)
def forked_children(monkeypatch):
    """Fork the recorders and guardians of runs in this process."""
    monkeypatch.setattr(child_process, "subprocess", FORKING)


class CommandLine:
    """Calls from an empty folder that is the working folder."""

    def __init__(self, folder, capsys):
        self.folder, self.capsys = folder, capsys

    def __call__(self, *words):
        """(exit code, standard output, standard error)"""
        self.capsys.readouterr()
        code = main([str(word) for word in words])
        return code, *self.capsys.readouterr()

    def refused(self, *words, code=BAD_INPUT):
        """The complaint about a command line that is refused, without `tickwork: ` and the newline at its end.

        Nothing else is said, and no file is made.
        """
        before = sorted(self.folder.rglob("*"))
        found, out, err = self(*words)
        after = [path for path in sorted(self.folder.rglob("*")) if "__pycache__" not in path.parts]
        assert (found, out) == (code, "")
        assert after == before
        assert err.endswith("\n") and "Traceback" not in err
        return err.removeprefix("tickwork: ")[:-1]


@pytest.fixture
def command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", environment()["PATH"])
    monkeypatch.setattr(sys, "argv", ["runtime"])
    return CommandLine(tmp_path, capsys)
