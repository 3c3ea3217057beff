"""Start of Rerun's viewers and servers. They listen on loopback by default, where Rerun listens on every address."""

from __future__ import annotations

import errno
import os
import signal
import socket
import subprocess
import time

from runtime.host.ending import ENDING_SIGNALS
from runtime.host.system import end_with_parent
from runtime.record.recorder.rerun.target import LOOPBACK, host_in_url

START_TIMEOUT = 15.0  # s
POLL_PERIOD = 0.02  # s
CONNECT_TIMEOUT = 0.5  # s
WILDCARDS = {"0.0.0.0": LOOPBACK, "::": "::1"}  # {wildcard address: address to connect to}
# HTTP/2 with empty settings (RFC 9113, 3.4)
PREFACE = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes([0, 0, 0, 4, 0, 0, 0, 0, 0])
SETTINGS_FRAME = 4  # type of the first frame of an HTTP/2 server (6.5)
PREFACE_TIMEOUT = 3.0  # s


class ViewerFailed(Exception):
    """A viewer cannot be started or reached. The text is the reason in one line."""


def answers(host: str, port: int, timeout: float = CONNECT_TIMEOUT) -> bool:
    """Return whether a process listens on a port."""
    try:
        socket.create_connection((host, port), timeout).close()
    except OSError:
        return False
    return True


def meet(host: str, port: int, timeout: float = PREFACE_TIMEOUT) -> None:
    """Connect once and check that the listener uses HTTP/2, as Rerun does. Raises ViewerFailed."""
    try:
        with socket.create_connection((host, port), timeout) as line:
            line.sendall(PREFACE)
            reply = line.recv(4)
    except ConnectionRefusedError:
        raise ViewerFailed(f"no Rerun viewer responds on {host} port {port}") from None
    except socket.gaierror as error:
        raise ViewerFailed(f"unknown host {host!r} ({error.strerror})") from None
    except TimeoutError:
        reply = b""
    except OSError as error:
        raise ViewerFailed(f"no Rerun viewer responds on {host} port {port} ({error.strerror})") from None
    if reply[3:] != bytes([SETTINGS_FRAME]):
        raise ViewerFailed(f"the process that listens on {host} port {port} is not a Rerun viewer")


def free(address: str, port: int) -> None:
    """Raise ViewerFailed if a server cannot listen on an address."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with socket.socket(family, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # allow a port that was closed just now
        try:
            probe.bind((address, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise ViewerFailed(
                    f"{address} port {port} is in use: end the process that listens there, or set another "
                    "port in the Rerun block"
                ) from None
            if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
                raise ViewerFailed(f"cannot serve on {address}: this machine has no such address") from None
            raise ViewerFailed(f"cannot serve on {address} port {port}: {error.strerror}") from None


def become_free(address: str, port: int, timeout: float) -> None:
    """Wait until a server can listen on an address. Raises ViewerFailed after `timeout` s."""
    deadline = time.monotonic() + timeout
    while True:
        try:
            return free(address, port)
        except ViewerFailed:
            if time.monotonic() >= deadline:
                raise
        time.sleep(POLL_PERIOD)


def reached_at(address: str) -> str:
    """Return the address for other machines; for a wildcard address that of the default network interface."""
    if address not in WILDCARDS:
        return address
    # documentation addresses, which are not in use
    family, far = (socket.AF_INET6, "2001:db8::1") if ":" in address else (socket.AF_INET, "192.0.2.1")
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((far, 9))  # sends nothing
            return probe.getsockname()[0]
        except OSError:
            return socket.gethostname()


def executable() -> str:
    """Return the path of Rerun's program."""
    import rerun_cli

    return os.path.join(os.path.dirname(rerun_cli.__file__), "rerun")


def start(*words: object, mortal: bool) -> subprocess.Popen:
    """Start Rerun's program. mortal : end it with this process"""

    def before():
        for number in ENDING_SIGNALS:
            signal.signal(number, signal.SIG_DFL)  # a child inherits ignored signals
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


def await_port(process: subprocess.Popen, host: str, port: int, doubt: str) -> None:
    """Wait until a port accepts connections. Raises ViewerFailed. doubt : possible cause of a failure"""
    deadline = time.monotonic() + START_TIMEOUT
    while not answers(host, port):
        if process.poll() is not None:
            raise ViewerFailed(f"Rerun's viewer exited immediately (code {process.returncode}): {doubt}")
        if time.monotonic() > deadline:
            process.kill()
            raise ViewerFailed(f"Rerun's viewer does not respond on {host} port {port}")
        time.sleep(POLL_PERIOD)


def viewer(port: int) -> tuple[subprocess.Popen | None, str]:
    """Return (process or None, host) of the viewer on a port of this machine. Start one if none runs."""
    if answers(LOOPBACK, port):
        meet(LOOPBACK, port)
        return None, LOOPBACK
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise ViewerFailed(
            "no display for Rerun's viewer: use --rerun serve for a browser or --rerun trial.rrd for a file"
        )
    process = start("--bind", LOOPBACK, "--port", port, "--expect-data-soon", mortal=False)
    await_port(process, LOOPBACK, port, "check its graphics driver")
    return process, LOOPBACK


def origins(address: str, web_port: int) -> list[str]:
    """Return the origins from which a browser may load the page: all names of this machine besides loopback."""
    name = socket.gethostname()
    return [
        f"http://{host_in_url(host)}:{web_port}" for host in dict.fromkeys((reached_at(address), name, f"{name}.local"))
    ]


def serve(address: str, port: int, web_port: int, timeout: float = 0.0) -> tuple[subprocess.Popen, str]:
    """Start a server for browsers. Returns (process, host). timeout : s to wait for the ports"""
    host = WILDCARDS.get(address, address)
    for number in (port, web_port):
        become_free(address, number, timeout)
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
    await_port(process, host, port, f"check whether ports {port} and {web_port} are free")
    return process, host
