"""One controller a bus: a lock that ends with its process and names it."""

import os
import pwd
import socket
import subprocess
import sys
import time

import pytest

from runtime.robot.guardian.lock import BusLock, BusTaken, in_words, name_of
from tests.runtime.runs import ROOT

HOLD = (
    "import sys; from runtime.robot.guardian.lock import BusLock\n"
    "lock = BusLock('socketcan', sys.argv[1]); print('held', flush=True); sys.stdin.read()"
)


@pytest.fixture
def channel():
    return f"can_of_{os.getpid()}"


def holding(channel):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, channel], cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    return process


@pytest.mark.hazard("H4e")
def test_bus_has_one_controller_and_its_process_is_named(channel):
    with holding(channel) as process:
        for _ in range(3):
            with pytest.raises(BusTaken, match=f"controlled by process {process.pid} \\(.* {channel}\\)") as taken:
                BusLock("socketcan", channel)
            assert taken.value.pid == process.pid
        BusLock("socketcan", f"{channel}_other").close()
        BusLock("slcan", channel).close()


def test_user_that_holds_bus_is_named(channel):
    name = pwd.getpwuid(os.geteuid()).pw_name
    with holding(channel) as process:
        with pytest.raises(BusTaken, match=f"controlled by process {process.pid} \\(.*\\) of user {name}$") as taken:
            BusLock("socketcan", channel)
        assert taken.value.user == os.geteuid()
        process.stdin.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be another user")
def test_other_user_that_holds_bus_is_named(channel):
    nobody = pwd.getpwnam("nobody").pw_uid
    os.seteuid(nobody)
    try:
        lock = BusLock("socketcan", channel)
    finally:
        os.seteuid(0)
    with pytest.raises(BusTaken, match=" of user nobody$"):
        BusLock("socketcan", channel)
    lock.close()


def test_account_without_name_is_reported_by_uid():
    assert in_words(0, 3_999_999_999) == "another process of user 3999999999"
    assert in_words(1 << 30, 3_999_999_999).startswith(f"process {1 << 30} of user 3999999999, which has ended")
    assert in_words(0, None) == "another process"


def test_the_lock_ends_with_its_process_even_by_kill_9(channel):
    with holding(channel) as process:
        process.kill()
        process.wait()
        began = time.monotonic()
        BusLock("socketcan", channel).close()
        assert time.monotonic() - began < 5.0


def test_a_lock_that_is_closed_is_free_again(channel):
    first = BusLock("socketcan", channel)
    with pytest.raises(BusTaken, match=f"process {os.getpid()} "):
        BusLock("socketcan", channel)
    first.close()
    BusLock("socketcan", channel).close()


def test_a_symlink_to_a_port_has_the_lock_of_the_port(tmp_path):
    (tmp_path / "ttyACM0").touch()
    (tmp_path / "by-id").symlink_to(tmp_path / "ttyACM0")
    lock = BusLock("slcan", str(tmp_path / "ttyACM0"))
    with pytest.raises(BusTaken):
        BusLock("slcan", str(tmp_path / "by-id"))
    lock.close()


def test_long_channels_have_distinct_lock_names():
    long = "usb:" + 200 * "x"
    assert name_of("gs_usb", long + "1") != name_of("gs_usb", long + "2")
    for channel in (long, "ü" * 60):
        with socket.socket(socket.AF_UNIX) as place:
            place.bind(name_of("gs_usb", channel))
