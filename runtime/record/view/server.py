"""The server of `view`: recordings for its pages.

A page asks, one question after the other, and each is answered by a thread, so that other pages and the ends of
connections are not delayed:

    {"do": "window", "id": 7, "recording": 0, "signals": [13, 34], "begin": 60.0, "end": 90.0, "width": 900}
    {"do": "average", "id": 8, "of": [[0, 60.0, 90.0], ...], "paths": ["left/knee.torque"]}     null for all of it

The answer to the first is binary: the length of a JSON head in 4 bytes, the head, padding to 8 bytes, and the doubles
of each piece that it lists: time, then low, high and broken of each signal, as in runtime.record.view.levels.Piece.
"""

from __future__ import annotations

import asyncio
import struct
from contextlib import suppress
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import numpy as np
from websockets.exceptions import ConnectionClosed

from runtime.host.errors import BadInput
from runtime.record.panel.site import Site, files_of
from runtime.record.view.average import average

if TYPE_CHECKING:
    from collections.abc import Sequence

    from websockets.asyncio.server import ServerConnection

    from runtime.record.view.recording import Recording

PAGE_FOLDER = "runtime.record.view.page"
FILES = files_of(
    PAGE_FOLDER, "index.html", "view.css", "view.js", "source.js", "charts.js", "timeline.js", "picture.js"
)
HOST = "127.0.0.1"
MESSAGE_LIMIT = 1 << 18  # bytes of a message of a page, which may list many signals
PROGRESS_PERIOD = 0.2  # s
POLICY = 1008  # code of RFC 6455
Seconds = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]


class Window(msgspec.Struct, tag_field="do", tag="window", forbid_unknown_fields=True):
    """Signals in a window."""

    id: int
    recording: int
    signals: list[int]
    begin: Seconds
    end: Seconds
    width: Annotated[float, msgspec.Meta(ge=1.0, le=20000.0)]


class Average(msgspec.Struct, tag_field="do", tag="average", forbid_unknown_fields=True):
    """The average stride of recordings, or of parts of them."""

    id: int
    of: list[tuple[int, Seconds | None, Seconds | None]]
    paths: list[str]


QUESTIONS = msgspec.json.Decoder(Window | Average)


class Viewer(Site):
    """The server of some recordings. recordings : [Recording]"""

    def __init__(self, recordings: Sequence[Recording]) -> None:
        super().__init__(HOST, FILES, MESSAGE_LIMIT)
        self.recordings = recordings
        self.hello = msgspec.json.encode({"type": "hello", "recordings": [each.describe() for each in recordings]})
        self.opened = 0
        self.averaging = asyncio.Lock()  # one at a time: each reads its recordings

    async def build(self) -> None:
        """Build the levels of all recordings, and send the progress to the pages."""
        for recording in self.recordings:
            building = asyncio.create_task(asyncio.to_thread(recording.levels.build))
            while not building.done():
                await asyncio.wait([building], timeout=PROGRESS_PERIOD)
                await asyncio.gather(*(self.send(connection, self.progress()) for connection in self.pages.values()))
            building.result()

    def progress(self) -> bytes:
        """Return how much of each recording can be shown, as a message."""
        return msgspec.json.encode({"type": "progress", "shares": [each.levels.share for each in self.recordings]})

    async def serve_page(self, connection: ServerConnection) -> None:
        """Serve one page until its connection ends."""
        self.opened += 1
        number = self.opened
        averages = set()
        try:
            await connection.send(self.hello, text=True)
            self.pages[number] = connection
            await self.send(connection, self.progress())
            async for message in connection:
                try:
                    question = QUESTIONS.decode(message)
                    self.check(question)
                except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, IndexError):
                    await connection.close(POLICY, "malformed message")
                    break
                if isinstance(question, Average):
                    task = asyncio.create_task(self.answer_average(connection, question))
                    averages.add(task)
                    task.add_done_callback(averages.discard)
                else:
                    await connection.send(await asyncio.to_thread(self.window, question))
        except ConnectionClosed:
            pass
        finally:
            for task in averages:
                task.cancel()
            self.pages.pop(number, None)

    def check(self, question: Window | Average) -> None:
        """Raise IndexError for a recording or a signal that does not exist."""
        numbers = [question.recording] if isinstance(question, Window) else [each[0] for each in question.of]
        if not all(0 <= number < len(self.recordings) for number in numbers):
            raise IndexError("recording")
        if isinstance(question, Window):
            count = len(self.recordings[question.recording].signals)
            if not all(0 <= place < count for place in question.signals):
                raise IndexError("signal")

    def window(self, question: Window) -> bytes:
        """Return the answer to a question."""
        recording = self.recordings[question.recording]
        head: dict[str, Any] = {"id": question.id, "share": recording.levels.share, "pieces": [], "problem": ""}
        arrays: list[np.ndarray] = []
        places = list(dict.fromkeys(question.signals))
        try:
            pieces = recording.levels.window(places, question.begin, max(question.begin, question.end), question.width)
        except (BadInput, OSError) as error:
            pieces, head["problem"] = [], str(error)
        for piece in pieces:
            factors = np.array([[recording.signals[place]["factor"]] for place in piece.places])
            head["pieces"].append(
                {"signals": piece.places, "size": piece.size, "step": piece.step, "count": len(piece.time)}
            )
            arrays += [piece.time, factors * piece.low, factors * piece.high, piece.broken.astype("<f8")]
        text = msgspec.json.encode(head)
        text += b" " * (-(len(text) + 4) % 8)
        doubles = (np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays)
        return b"".join([struct.pack("<I", len(text)), text, *doubles])

    async def close(self) -> None:
        """Stop building, and close all pages."""
        for recording in self.recordings:
            recording.levels.stopped = True
        await super().close()

    async def answer_average(self, connection: ServerConnection, question: Average) -> None:
        """Answer a question."""
        of = [
            (number, self.recordings[number], None if begin is None or end is None else (begin, end))
            for number, begin, end in question.of
        ]
        async with self.averaging:
            try:
                found = await asyncio.to_thread(average, of, question.paths)
            except (BadInput, OSError) as error:
                found = {"legs": [], "signals": [], "problems": [str(error)]}
        await self.send(connection, msgspec.json.encode({"type": "average", "id": question.id, **found}))

    async def send(self, connection: ServerConnection, message: bytes) -> None:
        """Send JSON to a page, unless it is gone."""
        with suppress(ConnectionClosed):
            await connection.send(message, text=True)
