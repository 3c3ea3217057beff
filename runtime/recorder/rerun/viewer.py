"""Viewers and servers that are started for a run. They listen on loopback unless told otherwise: Rerun's own default is
every address.
"""

import errno
import os
import signal
import socket
import subprocess
import time

from runtime.base.ending import ENDING_SIGNALS
from runtime.base.system import end_with_parent
from runtime.recorder.rerun.target import LOOPBACK, bracketed

STARTED = 15.0  # s for a server to answer
LOOK = 0.02  # s between looks whether it does
QUICK = 0.5  # s for a port to answer
ANYWHERE = {"0.0.0.0": LOOPBACK, "::": "::1"}  # where to reach what listens everywhere
# HTTP/2 with empty settings (RFC 9113, 3.4)
GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
SETTINGS = 4  # the first frame of whoever speaks it (6.5)
GREETED = 3.0  # s for that


class ViewerFailed(Exception):
    """A viewer cannot be started or reached. The text says why, in one line."""


def answers(host, port, timeout=QUICK):
    """Whether somebody listens there."""
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError:
        return False
    return True


def meet(host, port, timeout=GREETED):
    """Connect once, and hear that whoever listens there speaks what Rerun does. ViewerFailed"""
    try:
        with socket.create_connection((host, port), timeout) as line:
            line.sendall(GREETING)
            heard = line.recv(4)
    except ConnectionRefusedError:
        raise ViewerFailed(f"no viewer of Rerun answers on {host} port {port}") from None
    except socket.gaierror as error:
        raise ViewerFailed(f"there is no host {host!r} ({error.strerror})") from None
    except TimeoutError:
        heard = b""
    except OSError as error:
        raise ViewerFailed(f"no viewer of Rerun answers on {host} port {port} ({error.strerror})") from None
    if heard[3:] != bytes([SETTINGS]):
        raise ViewerFailed(f"what listens on {host} port {port} is no viewer of Rerun")


def free(address, port):
    """Refuse an address that a server could not listen on. ViewerFailed"""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # one that has just ended is no hindrance
        try:
            probe.bind((address, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise ViewerFailed(
                    f"somebody listens on {address} port {port} already: end that, or choose another "
                    "port of the Rerun block"
                ) from None
            if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
                raise ViewerFailed(f"cannot serve on {address}: this computer has no such address") from None
            raise ViewerFailed(f"cannot serve on {address} port {port}: {error.strerror}") from None


def become_free(address, port, patience):
    deadline = time.monotonic() + patience
    while True:
        try:
            return free(address, port)
        except ViewerFailed:
            if time.monotonic() >= deadline:
                raise
        time.sleep(LOOK)


def reached_at(address):
    """How others reach what listens on an address: of every address, the one that this computer has towards the rest of
    the network.
    """
    if address not in ANYWHERE:
        return address
    # of documents: nobody's
    family, far = (socket.AF_INET6, "2001:db8::1") if ":" in address else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))  # sends nothing
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()


def executable():
    import rerun_cli

    return os.path.join(os.path.dirname(rerun_cli.__file__), "rerun")


def start(*words, mortal):
    """Rerun's program with its words. mortal : it ends with this process, else it stays open for who looks at it"""

    def before():
        for number in ENDING_SIGNALS:
            signal.signal(number, signal.SIG_DFL)  # we ignore them, and it would inherit that
        if mortal:
            end_with_parent()

    return subprocess.Popen(
        [executable(), *map(str, words)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        preexec_fn=before,
    )


def await_port(process, host, port, doubt):
    """Until it answers. ViewerFailed, with the doubt about what may be wrong"""
    deadline = time.monotonic() + STARTED
    while not answers(host, port):
        if process.poll() is not None:
            raise ViewerFailed(f"Rerun ended at once (code {process.returncode}): {doubt}")
        if time.monotonic() > deadline:
            process.kill()
            raise ViewerFailed(f"Rerun's viewer does not answer on {host} port {port}")
        time.sleep(LOOK)


def viewer(port):
    """(process or None, host): the viewer of this machine that listens on a port, started where none does."""
    if answers(LOOPBACK, port):
        meet(LOOPBACK, port)
        return None, LOOPBACK
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ViewerFailed(
            "there is no screen for Rerun's viewer; --rerun serve shows the run in a browser, --rerun "
            "trial.rrd writes a file"
        )
    process = start("--bind", LOOPBACK, "--port", port, "--expect-data-soon", mortal=False)
    await_port(process, LOOPBACK, port, "can it draw on this screen?")
    return process, LOOPBACK


def origins(address, web_port):
    """Where the page that a browser elsewhere shows may come from: the names of this computer. Of loopback Rerun allows
    it anyhow.
    """
    name = socket.gethostname()
    return [
        f"http://{bracketed(host)}:{web_port}" for host in dict.fromkeys((reached_at(address), name, f"{name}.local"))
    ]


def serve(address, port, web_port, patience=0.0):
    """(process, host): a server for browsers, on an address and two ports. patience : s for them to become free"""
    host = ANYWHERE.get(address, address)
    for number in (port, web_port):
        become_free(address, number, patience)
    process = start(
        "--serve-web",
        "--bind",
        address,
        "--port",
        port,
        "--web-viewer-port",
        web_port,
        *(word for origin in origins(address, web_port) for word in ("--cors-allow-origin", origin)),
        mortal=True,
    )
    await_port(process, host, port, f"are ports {port} and {web_port} free?")
    return process, host
