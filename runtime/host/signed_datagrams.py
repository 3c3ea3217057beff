"""Signed datagrams of a button on a network that others also use.

    sender      48 bytes: a CAN frame (16), the session (8), a rising number (8, little-endian), a tag (16)
    receiver    16 bytes, in reply to a datagram of another session: "tickwork", the session (8)

The tag is the first half of HMAC-SHA256 of the 32 bytes before it, with the key that both have. The receiver draws its
session at random when it starts, and accepts a number once: no recorded datagram counts again, in this run or another.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
from pathlib import Path

FRAME_BYTES, SESSION_BYTES, NUMBER_BYTES, TAG_BYTES = 16, 8, 8, 16
SIGNED_BYTES = FRAME_BYTES + SESSION_BYTES + NUMBER_BYTES
DATAGRAM_BYTES = SIGNED_BYTES + TAG_BYTES
GREETING = b"tickwork"
KEY_BYTES = 32
MAKE_KEY = "openssl rand -hex 32 > {path}; chmod 600 {path}"


def tag(key: bytes, content: bytes) -> bytes:
    """Return the tag of signed bytes."""
    return hmac.new(key, content, hashlib.sha256).digest()[:TAG_BYTES]


def seal_datagram(key: bytes, frame: bytes, session: bytes, number: int) -> bytes:
    """Return the datagram of a frame. session : that of the receiver; number : larger than in the datagram before"""
    content = frame + session + number.to_bytes(NUMBER_BYTES, "little")
    return content + tag(key, content)


def open_datagram(key: bytes, datagram: bytes) -> tuple[bytes, bytes, int] | None:
    """Return (frame, session, number) of a datagram, None if it is not signed with the key."""
    content = datagram[:SIGNED_BYTES]
    if len(datagram) != DATAGRAM_BYTES or not hmac.compare_digest(tag(key, content), datagram[SIGNED_BYTES:]):
        return None
    session = content[FRAME_BYTES : FRAME_BYTES + SESSION_BYTES]
    return content[:FRAME_BYTES], session, int.from_bytes(content[-NUMBER_BYTES:], "little")


def session_of(reply: bytes) -> bytes | None:
    """Return the session in a reply of the receiver, None if it is not one."""
    fits = len(reply) == len(GREETING) + SESSION_BYTES and reply.startswith(GREETING)
    return reply[len(GREETING) :] if fits else None


class Receiver:
    """Receiver of signed datagrams. key : shared with the sender"""

    def __init__(self, key: bytes) -> None:
        self.key, self.session, self.newest = key, os.urandom(SESSION_BYTES), -1

    def frame(self, datagram: bytes) -> tuple[bytes | None, bytes | None]:
        """Return (frame, None) for a datagram that counts, else (None, the reply to it or None)."""
        found = open_datagram(self.key, datagram)
        if found is None:
            return None, None
        frame, session, number = found
        if session != self.session:
            return None, GREETING + self.session
        if number <= self.newest:
            return None, None
        self.newest = number
        return frame, None


class Signer:
    """Sender of signed datagrams, which adopts the session of its receiver. key : shared with the receiver"""

    def __init__(self, key: bytes) -> None:
        self.key, self.session, self.number = key, bytes(SESSION_BYTES), 0

    def datagram(self, frame: bytes) -> bytes:
        """Return the datagram of a frame."""
        self.number += 1
        return seal_datagram(self.key, frame, self.session, self.number)

    def note(self, reply: bytes) -> None:
        """Adopt the session of a reply."""
        self.session = session_of(reply) or self.session


def read_key(path: str | Path) -> bytes:
    """Return the key in a file of 64 hex digits that only its owner can read. Raises ValueError with the reason."""
    try:
        with open(path, "rb") as file:
            status, text = os.fstat(file.fileno()), file.read(4 * KEY_BYTES)
    except OSError as error:
        raise ValueError(error.strerror) from None
    if status.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError(f"other accounts may read it (mode {stat.S_IMODE(status.st_mode):o})")
    try:
        key = bytes.fromhex(text.decode("ascii"))
    except ValueError:
        key = b""
    if len(key) != KEY_BYTES:
        raise ValueError(f"expected {2 * KEY_BYTES} hex digits")
    return key
