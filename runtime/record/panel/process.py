"""The process of the panel. Its service in the recorder starts it, and it ends with the recorder.

It answers with {"ready": {role: address}, "port": number} or {"error": text} once it listens. Then it takes the events
of the recording from a socket of type SOCK_SEQPACKET, as JSON.
"""

from __future__ import annotations

import asyncio
import json
import os
import socket
import sys
import time
from contextlib import suppress
from typing import Any

from cext.memory.shared_state import SharedState
from runtime.host.system import name_process
from runtime.record.panel.server import Server
from runtime.record.panel.view import View

EVENT_BYTES = 1 << 17  # of a message
PRIORITY = 1  # of SCHED_FIFO, below that of the loop and of the guardian
PORT_TIMEOUT = 5.0  # s for a panel before this one to release a port


def main(answers: int, control: int, shared: int, events: int) -> None:
    """Run the process.

    answers : file descriptor of the pipe to the recorder
    control : pidfd of the recorder
    shared : file descriptor of the shared state
    events : file descriptor of the socket with the events
    """
    name_process("tickwork-panel")
    plan = json.loads(sys.stdin.readline())
    state = SharedState(fd=shared)
    asyncio.run(Panel(plan, state, answers, socket.socket(fileno=events)).run())


class Panel:
    """The panel of one run.

    plan : of the recorder
    answers : file descriptor of the pipe to the recorder
    events : socket with the events of the recording
    """

    def __init__(self, plan: dict[str, Any], shared: SharedState, answers: int, events: socket.socket) -> None:
        self.plan, self.shared, self.answers, self.events = plan, shared, answers, events
        self.view = View(plan, shared)
        self.server = Server(self.view, plan["host"], plan["secret"])
        self.over = asyncio.Event()

    async def run(self) -> None:
        """Listen, and serve the pages until the recorder has ended."""
        try:
            await self.listen()
        except OSError as error:
            self.answer({"error": error.strerror})
            return
        self.answer({"ready": self.server.addresses(), "port": self.server.port})
        if self.plan["lost"] == "stop":  # other programs shall not delay the replies of the page
            with suppress(OSError):
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(PRIORITY))
        loop = asyncio.get_running_loop()
        self.events.setblocking(False)
        loop.add_reader(self.events, self.take_events)
        control = os.pidfd_open(self.shared.control)
        loop.add_reader(control, self.control_ended, control)
        os.set_blocking(self.answers, False)
        self.server.mailbox.noted = self.send_notes
        publishing = asyncio.create_task(self.server.publish(self.send_notes))
        await self.over.wait()
        publishing.cancel()
        await self.server.close()

    async def listen(self) -> None:
        """Listen on the port of the panel before this one, else on that of the plan. Raises OSError."""
        before, until = self.plan["port_before"], time.monotonic() + PORT_TIMEOUT
        while before and time.monotonic() < until:  # pages connect again where they were
            try:
                await self.server.listen(before)
            except OSError:
                await asyncio.sleep(0.05)
            else:
                return
        await self.server.listen_first(self.plan["port"])

    def answer(self, message: dict[str, Any]) -> None:
        """Send one line of JSON to the recorder."""
        os.write(self.answers, json.dumps(message).encode() + b"\n")

    def send_notes(self) -> None:
        """Send the notes on marks to the recorder, as far as it takes them."""
        notes = self.server.mailbox.notes
        while notes:
            try:
                self.answer({"note": notes[0]})
            except BlockingIOError:
                return
            except BrokenPipeError:  # the recorder ends
                notes.clear()
                return
            notes.pop(0)

    def take_events(self) -> None:
        """Take the events that have arrived. The end of the socket is the end of the recorder."""
        while True:
            try:
                message = self.events.recv(EVENT_BYTES)
            except BlockingIOError:
                return
            except OSError:
                message = b""
            if not message:
                asyncio.get_running_loop().remove_reader(self.events)
                self.over.set()
                return
            event = json.loads(message)
            if event.get("event") == "complete":
                self.view.complete = True
                continue
            self.server.take_event(event)

    def control_ended(self, control: int) -> None:
        """Show that the control process has ended, which it does after its last record."""
        asyncio.get_running_loop().remove_reader(control)
        self.view.gone = not self.shared.closed
        self.server.refresh()
