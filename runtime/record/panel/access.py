"""Access to the panel: which connections are accepted, and what each page may do.

On the loopback address, pages of the same account may operate the run. On any other address a page needs one of two
tokens, which are printed in its address: one to view, one to operate. A browser sends the part of an address after `#`
to no server, so that a token is in no log.
"""

from __future__ import annotations

import hmac
import os
import socket
from hashlib import sha256
from ipaddress import ip_address

VIEW, OPERATE = "view", "operate"
TOKEN_LENGTH = 20  # hex digits
LOCAL_NAMES = ("127.0.0.1", "localhost", "[::1]")
TABLES = ("/proc/net/tcp", "/proc/net/tcp6")
LOCAL, REMOTE, STATE, UID = 1, 2, 3, 7  # fields of a line of these tables
ESTABLISHED = "01"


def is_local(host: str) -> bool:
    """Return whether an address is that of this computer alone."""
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def derived(secret: str, purpose: str) -> str:
    """Return a text that is the same for each part of a run, and does not reveal its secret."""
    return hmac.new(secret.encode(), purpose.encode(), sha256).hexdigest()[:TOKEN_LENGTH]


def reachable(host: str) -> str:
    """Return the address under which other computers reach a host: of 0.0.0.0 or ::, that of the route outwards."""
    if host not in ("0.0.0.0", "::"):
        return host
    family, documentation = (socket.AF_INET, "192.0.2.1") if host == "0.0.0.0" else (socket.AF_INET6, "2001:db8::1")
    with socket.socket(family, socket.SOCK_DGRAM) as made:
        try:
            made.connect((documentation, 9))  # sends nothing
        except OSError:  # no network
            return socket.gethostname()
        return made.getsockname()[0]


def tokens(secret: str) -> dict[str, str]:
    """Return {token: role} of a run. secret : of the run"""
    return {derived(secret, role): role for role in (VIEW, OPERATE)}


def role_of(token: str, known: dict[str, str]) -> str | None:
    """Return the role that a token gives, None for a wrong one. known : as `tokens` returns it"""
    found = None
    for other, role in known.items():
        if hmac.compare_digest(token.encode(), other.encode()):
            found = role
    return found


def same_origin(origin: str | None, host: str | None, local: bool) -> bool:
    """Return whether a WebSocket was opened by the panel's own page, and not by another site in the same browser.

    origin, host : headers of the request
    local : whether the panel serves this computer alone: a name that resolves to it is then no proof
    """
    if not origin or not host or origin != f"http://{host}":
        return False
    return not local or host.rpartition(":")[0] in LOCAL_NAMES or host in LOCAL_NAMES


def of_this_account(peer: int, port: int) -> bool:
    """Return whether a connection from this computer is of a process of this account, or of root.

    peer, port : TCP ports of its two ends; the second is that of the panel
    """
    for table in TABLES:
        try:
            with open(table) as file:
                lines = file.readlines()[1:]
        except OSError:
            continue
        for line in lines:
            fields = line.split()
            if (
                fields[STATE] == ESTABLISHED
                and fields[LOCAL].endswith(f":{peer:04X}")
                and fields[REMOTE].endswith(f":{port:04X}")
                and is_loopback_entry(fields[LOCAL])
            ):
                return int(fields[UID]) in (os.getuid(), 0)
    return False


def is_loopback_entry(address: str) -> bool:
    """Return whether an address of the tables, in hex and with its port, is 127.0.0.0/8, ::1, or one mapped to IPv6."""
    text = address.partition(":")[0]
    return text[-8:].endswith("7F") or text == "0" * 24 + "01000000"
