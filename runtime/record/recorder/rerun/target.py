"""Destination of a live run: `--rerun`, `--rerun trial.rrd`, `--rerun serve`, `--rerun 192.168.1.7`."""

from __future__ import annotations

import re
from dataclasses import dataclass

from runtime.host.errors import BadInput

LOOPBACK = "127.0.0.1"
PORT, WEB_PORT = 9876, 9090  # Rerun's defaults
EXPECTED = "expected no value, a file.rrd, serve, serve:ADDRESS, or HOST:PORT of a viewer"


@dataclass(frozen=True)
class Target:
    """Destination of a live run.

    kind : "viewer", on this machine, started if none runs; "file"; "serve", for a browser; or "connect", to a viewer
        of another machine
    place : path of the file; address to serve on; or host
    port : port of the viewer or the server
    """

    kind: str
    place: str
    port: int


def parse(text: str, port: int = PORT) -> Target:
    """Convert the text of --rerun to a Target. Raises BadInput."""
    if not text:
        return Target("viewer", LOOPBACK, port)
    if text.endswith(".rrd"):
        return Target("file", text, port)
    if text == "serve" or text.startswith("serve:"):
        return Target("serve", text.removeprefix("serve").removeprefix(":").strip("[]") or LOOPBACK, port)
    found = re.fullmatch(r"(?:rerun\+http://)?(\[[0-9A-Fa-f:.]+\]|[\w.-]+?)(?::(\d+))?(?:/proxy)?", text)
    if (
        found is None
        or "." in text
        and text.rpartition(".")[2].isalpha()
        and found[2] is None
        and "/" in text
        or not 0 < int(found[2] or port) < 65536
    ):
        raise BadInput(f"--rerun {text}: {EXPECTED}")
    return Target("connect", found[1].strip("[]"), int(found[2] or port))


def host_in_url(host: str) -> str:
    """Return a host as written in a URL."""
    return f"[{host}]" if ":" in host else host


def url(host: str, port: int) -> str:
    """Return the URL of a viewer's data port."""
    return f"rerun+http://{host_in_url(host)}:{port}/proxy"
