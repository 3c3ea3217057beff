"""Senders of emulated network devices: UDP datagrams to the port of the run, or a server for the run to connect to."""

from __future__ import annotations

import socket
import threading
from contextlib import suppress

from runtime.host.errors import BadInput
from runtime.host.signed_datagrams import Signer
from runtime.robot.emulation.priority import take_priority

THIS_MACHINE = {"0.0.0.0": "127.0.0.1", "::": "::1"}  # address of every network: that of this machine
READ_BYTES = 65536


class NetworkSender(threading.Thread):
    """Thread that sends the messages of an emulated device to the run.

    An emulator writes a message in parts, over several steps of the plant; the thread joins them. Datagrams are
    lost while no program receives them, as those of a real sender. A client that does not read is disconnected.

    transport, address : transport and address of the robot's device or bus. With "udp" the run listens there, with
        "tcp" this server does
    message_bytes : size of each message
    sender : address from which datagrams are sent, "" for any
    key : that signs datagrams (runtime.host.signed_datagrams), or None

    source : socket into which the emulator writes
    description : transport and address, as text
    Raises BadInput if the address of the server or of the sender cannot be used.
    """

    def __init__(
        self, transport: str, address: str, message_bytes: int, sender: str = "", key: bytes | None = None
    ) -> None:
        super().__init__(daemon=True)
        host, port = split_address(address)
        self.message_bytes, self.clients, self.target = message_bytes, [], None
        self.signer = None if key is None else Signer(key)
        self.description = f"{transport} {address}"
        try:
            if transport == "udp":
                self.target = (THIS_MACHINE.get(host, host), port)
                self.socket = socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_DGRAM)
                if sender:
                    self.socket.bind(split_address(sender))
            else:
                self.socket = socket.create_server((host, port))
                self.socket.setblocking(False)
        except OSError as error:
            raise BadInput(
                f"{transport} {sender or address}: {error.strerror}. Choose an address of this computer and a free port"
            ) from None
        self.source, self.parts = socket.socketpair()
        self.start()

    def run(self) -> None:
        """Send each message as soon as it is complete, until `close`."""
        take_priority()
        pending = b""
        while data := self.parts.recv(READ_BYTES):
            pending += data
            while len(pending) >= self.message_bytes:
                message, pending = pending[: self.message_bytes], pending[self.message_bytes :]
                self.send(message)

    def send(self, message: bytes) -> None:
        """Send one message to the port of the run, or to every client."""
        if self.target is not None:
            with suppress(OSError):
                self.socket.sendto(message if self.signer is None else self.signer.datagram(message), self.target)
            if self.signer is not None:
                with suppress(OSError):
                    self.signer.note(self.socket.recv(READ_BYTES, socket.MSG_DONTWAIT))
            return
        with suppress(BlockingIOError):
            client, _ = self.socket.accept()
            client.setblocking(False)
            self.clients.append(client)
        for client in list(self.clients):
            sent = 0
            with suppress(OSError):
                sent = client.send(message)
            if sent < len(message):
                self.clients.remove(client)
                client.close()

    def close(self) -> None:
        """End the thread and close its sockets."""
        self.parts.shutdown(socket.SHUT_RDWR)
        self.join()
        for end in (*self.clients, self.socket, self.source, self.parts):
            end.close()


def split_address(address: str) -> tuple[str, int]:
    """Return (host, port) of HOST:PORT or [HOST]:PORT."""
    host, _, port = address.rpartition(":")
    return host.strip("[]"), int(port)
