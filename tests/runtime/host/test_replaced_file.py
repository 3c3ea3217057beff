"""A file that is replaced is the old one or the new one, whatever ends the process in between."""

import errno
import os
import resource
import signal
import stat
import subprocess
import sys

import pytest

from runtime.host.errors import BadInput
from runtime.host.replaced_file import replacement, write
from runtime.setup.laboratory import create
from tests.runtime.runs import ROOT, environment


def test_kill_9_in_the_middle_leaves_the_old_file(tmp_path):
    path = tmp_path / "robot.svg"
    path.write_text("old")
    code = (
        "import os, signal\nfrom runtime.host.replaced_file import replacement\n"
        f"with replacement({str(path)!r}) as file:\n"
        "    file.write(b'new' * 100_000); file.flush(); os.kill(os.getpid(), signal.SIGKILL)"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=environment())
    assert done.returncode == -signal.SIGKILL and path.read_text() == "old"


def test_full_disk_leaves_the_old_file_and_nothing_else(tmp_path):
    path = tmp_path / "robot.svg"
    path.write_text("old")
    limits, handler = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        with pytest.raises(OSError) as caught:
            write(path, "new" * 1000)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert caught.value.errno == errno.EFBIG
    assert path.read_text() == "old" and os.listdir(tmp_path) == ["robot.svg"]


def test_an_exception_leaves_the_old_file(tmp_path):
    write(tmp_path / "a", "old")
    with pytest.raises(ZeroDivisionError), replacement(tmp_path / "a") as file:
        file.write(b"new")
        raise ZeroDivisionError
    assert (tmp_path / "a").read_text() == "old" and os.listdir(tmp_path) == ["a"]


def test_permissions_and_links_stay(tmp_path):
    write(tmp_path / "a", "old")
    os.chmod(tmp_path / "a", 0o641)
    os.symlink("a", tmp_path / "link")
    write(tmp_path / "link", "new")
    assert os.readlink(tmp_path / "link") == "a" and (tmp_path / "a").read_text() == "new"
    assert stat.S_IMODE(os.stat(tmp_path / "a").st_mode) == 0o641


def test_a_device_is_written_directly():
    write("/dev/null", "new")
    assert stat.S_ISCHR(os.stat("/dev/null").st_mode)


def test_a_new_package_is_there_as_a_whole_or_not_at_all(tmp_path, monkeypatch):
    def full(path, data):
        if path.suffix == ".toml":
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(path, data)

    with monkeypatch.context() as patch:
        patch.setattr("runtime.setup.laboratory.write", full)
        with pytest.raises(BadInput, match="cannot write .*my_lab: No space left on device"):
            create(tmp_path / "my_lab")
    assert os.listdir(tmp_path) == []
    assert all(path.exists() for path in create(tmp_path / "my_lab")) and os.listdir(tmp_path) == ["my_lab"]
