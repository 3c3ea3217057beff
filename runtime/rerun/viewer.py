"""Viewers and servers that are started for a run. They listen on loopback unless told otherwise: Rerun's own default is every address."""

import ctypes
import os
import signal
import socket
import subprocess
import time

from runtime.rerun.target import LOOPBACK

PR_SET_PDEATHSIG = 1            # linux/prctl.h
STARTED = 15.0                  # s for a server to answer
LOOK = 0.02                     # s between looks whether it does
QUICK = 0.5                     # s for a port to answer
ANYWHERE = {"0.0.0.0": LOOPBACK, "::": "::1"}       # where to reach what listens everywhere


class ViewerFailed(Exception):
    """A viewer cannot be started or reached. The text says why, in one line."""


def answers(host, port, timeout=QUICK):
    """Whether somebody listens there."""
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError:
        return False
    return True


def executable():
    import rerun_cli

    return os.path.join(os.path.dirname(rerun_cli.__file__), "rerun")


def start(*words, mortal):
    """Rerun's program with its words. mortal : it ends with this process, else it stays open for who looks at it"""
    prctl = ctypes.CDLL(None, use_errno=True).prctl

    def before():
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)                   # we ignore them, and it would inherit that
        if mortal:
            prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)

    return subprocess.Popen(
        [executable(), *map(str, words)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        start_new_session=True, preexec_fn=before)


def await_port(process, host, port):
    """Until it answers. ViewerFailed"""
    deadline = time.monotonic() + STARTED
    while not answers(host, port):
        if process.poll() is not None:
            raise ViewerFailed(f"Rerun's viewer ended at once (code {process.returncode}): is there a screen, and is port {port} free?")
        if time.monotonic() > deadline:
            process.kill()
            raise ViewerFailed(f"Rerun's viewer does not answer on {host} port {port}")
        time.sleep(LOOK)


def viewer(port):
    """(process or None, host): the viewer of this machine that listens on a port, started where none does."""
    if answers(LOOPBACK, port):
        return None, LOOPBACK
    process = start("--bind", LOOPBACK, "--port", port, "--expect-data-soon", mortal=False)
    await_port(process, LOOPBACK, port)
    return process, LOOPBACK


def serve(address, port, web_port):
    """(process, host): a server for browsers, on an address and two ports."""
    host = ANYWHERE.get(address, address)
    for number in (port, web_port):
        if answers(host, number):
            raise ViewerFailed(f"somebody listens on {host} port {number} already: end that, or choose another port of the Rerun block")
    process = start("--serve-web", "--bind", address, "--port", port, "--web-viewer-port", web_port, mortal=True)
    await_port(process, host, port)
    return process, host
