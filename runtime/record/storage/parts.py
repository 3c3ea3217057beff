"""Recording: the parts of a run whose recorder was killed and continued by another one, as one.

Part 2 of `trial.mcap` is `trial_part2.mcap` beside it, and so on. Together they hold every tick once.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from runtime.host.errors import BadInput
from runtime.record.storage.batches import NO_FRAMES, Batch, Rows
from runtime.record.storage.reader import Reader, Unbegun

PART = re.compile(r"(.+)_part(\d+)")


@dataclass(frozen=True)
class Seam:
    """Begin of a further part.

    rows : complete rows before it; further rows in the parts before do not count
    since : ns of the files from which frames of the parts before do not count; None if all do
    drains, drained : number of bus drains before it, and time of the last one in ns of the files
    """

    rows: int
    since: int | None
    drains: int
    drained: int


def heads(paths: Iterable[str | Path]) -> list[Path]:
    """Return those paths that do not continue another one of them."""
    paths = [Path(path) for path in paths]
    names = {(path.parent, path.stem) for path in paths}
    return [
        path for path in paths if (match := PART.fullmatch(path.stem)) is None or (path.parent, match[1]) not in names
    ]


def newest(path: str | Path) -> Path:
    """Return the newest recording of a folder. A path that is not a folder with recordings is returned unchanged."""
    there = (file for file in Path(path).glob("*.mcap") if file.exists())  # no link to a recording that was moved
    return max(heads(there), key=lambda file: file.stat().st_mtime_ns, default=Path(path))


def readers_of(path: Path, read: Callable[[Path], Reader]) -> tuple[list[Reader], dict[str, Any]]:
    """Return the readers of a file and of the parts that continue it, and the metadata of the first one.

    read : function that opens one file

    Raises BadInput.
    """
    readers: list[Reader] = []
    number, empty = 1, None
    try:
        readers.append(read(path))
        number = readers[0].about.get("part", 1)
    except Unbegun as error:
        empty = error
    first = number
    stem = path.stem.removesuffix(f"_part{number}") if number > 1 else path.stem
    while (following := path.with_name(f"{stem}_part{number + 1}{path.suffix}")).exists():
        number += 1
        try:
            reader = read(following)
        except BadInput:  # its recorder was also killed before its first tick
            continue
        if reader.about.get("part") != number or readers and not are_of_one_run(readers, reader):
            break  # of another run of the same name
        readers.append(reader)
    if empty and not readers:
        raise empty
    return readers, {**readers[0].about, "part": first}


def is_unbegun(reader: Reader) -> bool:
    """Return whether the recorder of a part was killed before it wrote the start of the run."""
    return not any(event["event"] == "begin" for event in reader.events)


def are_of_one_run(readers: list[Reader], second: Reader) -> bool:
    """Return whether a part has the diagram, the signals and, where both are known, the start of those before it."""
    here, there = (
        (part.about.get("hash"), [signal["path"] for signal in part.about["signals"]]) for part in (readers[0], second)
    )
    return here == there and len({part.began for part in (*readers, second) if not is_unbegun(part)}) < 2


class Recording:
    """Parts of one run as one recording.

    path : path of the first part
    read : function that opens one file

    readers : readers of the parts
    about, diagram : as in Contents, of the first part
    seams : [Seam] of each part but the first

    Raises BadInput.
    """

    def __init__(self, path: Path, read: Callable[[Path], Reader]) -> None:
        self.readers, self.about = readers_of(path, read)
        self.diagram = self.readers[0].diagram
        self.arrange()

    def arrange(self) -> None:
        """Place the rows and frames of every part."""
        self.seams: list[Seam] = []
        self.began = 0
        if len(self.readers) > 1:
            unbegun = [reader for reader in self.readers if is_unbegun(reader)]
            self.began = next((reader for reader in self.readers if reader not in unbegun), self.readers[0]).began
            for reader in unbegun:
                reader.began = self.began
        for number in range(1, len(self.readers)):
            self.seams.append(self.seam(number, self.readers[number]))

    @property
    def end(self) -> Any:
        """Content of end.json of the last part; None if it has none."""
        return self.readers[-1].end

    @property
    def finished(self) -> bool:
        """Whether the recorder has completed the last part, and no part is damaged."""
        return self.readers[-1].finished and not self.problems

    @property
    def problems(self) -> list[str]:
        """Problems with the parts, apart from those that their recorder did not finish and lack nothing."""
        self.check()
        return [reader.trouble for reader in self.readers if reader.trouble and not reader.is_unfinished]

    @property
    def unverified(self) -> int:
        """Number of ticks that are not verified by a checksum."""
        self.check()
        return sum(reader.unverified for reader in self.readers)

    @property
    def is_damaged(self) -> bool:
        """Whether bytes of a part are damaged, apart from a missing end."""
        self.check()
        return any(reader.is_damaged for reader in self.readers)

    @property
    def gaps(self) -> list[tuple[int, int]]:
        """[(last tick before, first tick after)] of the damaged bytes between ticks of a part."""
        self.check()
        return [gap for reader in self.readers for gap in reader.gaps]

    @property
    def trouble(self) -> str:
        """Problem with a damaged part or the last part, in one line; "" without one."""
        last = self.readers[-1]
        return "; ".join([*self.problems, *([last.trouble] if last.is_unfinished else [])])

    @property
    def paths(self) -> list[Path]:
        """Paths of the parts."""
        return [reader.path for reader in self.readers]

    def check(self, progress: Callable[[float], None] = lambda share: None) -> None:
        """Check every message. Argument and errors as in Reader.check."""
        for number, reader in enumerate(self.readers):
            reader.check(lambda share, number=number: progress((number + share) / len(self.readers)))

    def starts(self, count: int | None = None) -> list[int]:
        """Return the number of rows before each part, and of all. count : number of parts"""
        starts = [0]
        for number, reader in enumerate(self.readers[:count]):
            starts.append(min([starts[-1] + len(reader), *(seam.rows for seam in self.seams[number:])]))
        return starts

    def __len__(self) -> int:
        """Return the number of complete rows."""
        return self.starts()[-1]

    @property
    def events(self) -> list[dict[str, Any]]:
        """Events of all parts."""
        return [
            event
            for number, reader in enumerate(self.readers)
            for event in reader.events
            if number == 0 or event["event"] != "begin" or all(map(is_unbegun, self.readers[:number]))
        ]

    def rows(self, places: Sequence[int], first: int = 0, last: int | None = None) -> Rows:
        """Read rows. Arguments and result as those of Reader.rows."""
        length = len(self)
        last = length if last is None else min(last, length)
        if len(self.readers) == 1:
            return self.readers[0].rows(places, first, last)
        starts, parts = self.starts(), [Rows.empty(0, len(places))]
        for reader, begin, end in zip(self.readers, starts, starts[1:]):
            low, high = max(first, begin), min(last, end)
            if low < high:
                parts.append(reader.rows(places, low - begin, high - begin))
        return Rows(*map(np.concatenate, zip(*parts)))

    def row_from(self, name: str, value: float) -> int:
        """Return the number of the first row whose tick or time is `value` or more. name : "tick" or "time" """
        starts = self.starts()
        for reader, begin, end in zip(self.readers, starts, starts[1:]):
            row = reader.row_from(name, value)
            if row < end - begin:
                return begin + row
        return starts[-1]

    def adjust_frames(self, number: int, frames: Any) -> Any:
        """Return frames of a part with the numbers of all parts, without those that do not count."""
        starts = self.starts(number)
        frames = frames.copy()
        frames["row"] += starts[-1]
        if number:
            seam = self.seams[number - 1]
            first = frames["drain"] == 0
            frames["drained"][first] = seam.drained - self.began
            frames["drain"] += seam.drains
        for seam in self.seams[number:]:
            if self.is_cut(seam, number):
                kept = frames["row"] <= seam.rows
                if seam.since is not None:
                    kept &= frames["time"] < seam.since - self.began
                frames = frames[kept]
        return frames

    def is_cut(self, seam: Seam, number: int) -> bool:
        """Return whether a seam removes rows of the parts before it."""
        return seam.since is not None or self.starts(number)[-1] + len(self.readers[number]) > seam.rows

    def frames_of(self, number: int) -> Iterator[Any]:
        """Yield the frames of the chunks of a part."""
        for frames in self.readers[number].frames():
            yield self.adjust_frames(number, frames)

    def last_frames(self, count: int) -> Iterator[Any]:
        """Yield the frames of the first `count` parts by chunks, from the last to the first."""
        for number in reversed(range(count)):
            reader = self.readers[number]
            for chunk in reversed(reader.with_messages(reader.layout.buses)):
                for frames in reader.frames([chunk]):
                    yield self.adjust_frames(number, frames)

    def seam(self, number: int, second: Reader) -> Seam:
        """Return the Seam of a part.

        A recorder that was stopped before it was killed leaves rows that this part contains as well.
        """
        rows = beyond = self.starts(number)[-1]
        if len(second):
            beyond = self.row_before(number, int(second.rows([], 0, 1).tick[0]), rows)
        since = None
        if beyond < rows:
            first = next((frames for frames in second.frames() if len(frames)), None)
            since = None if first is None else second.began + int(first["time"][0])
        self.seams.append(Seam(beyond, since, 0, 0))  # while the frames before it are read
        drained = next((int(frames["drained"][-1]) for frames in self.last_frames(number) if len(frames)), 0)
        offset = self.drains_before(number, second, beyond)
        self.seams.pop()
        return Seam(beyond, since, offset, self.began + drained)

    def row_before(self, number: int, tick: int, rows: int) -> int:
        """Return the number of rows of the first `number` parts that precede a tick. rows : rows of all these parts"""
        starts = self.starts(number)
        for reader, begin, end in zip(self.readers[:number], starts, starts[1:]):
            row = reader.row_from("tick", tick)
            if row < end - begin:
                return begin + row
        return rows

    def drains_before(self, number: int, second: Reader, rows: int) -> int:
        """Return how many bus drains precede a part whose count restarts. There is one drain a row.

        rows : number of rows before the part
        """
        here = difference(self.last_frames(number), last=True)
        there = difference(second.frames(), last=False)
        if here is None or there is None:
            return max((int(frames["drain"].max()) for frames in self.last_frames(number) if len(frames)), default=0)
        return here + rows - there

    def batches(self, frames: bool = True) -> Iterator[Batch]:
        """Yield Batches, in order: one a chunk, and a last one without rows for the frames after the last row.

        frames : whether they are read
        """
        starts, pending, done = self.starts(), NO_FRAMES, 0
        for number, reader in enumerate(self.readers):
            for rows, part in reader.stream(frames):
                pending = np.concatenate((pending, self.adjust_frames(number, part))) if frames else part
                rows = rows[: max(0, starts[number + 1] - done)]
                if len(rows):
                    done += len(rows)
                    ready = pending["row"] < done
                    yield Batch(rows, pending[ready])
                    pending = pending[~ready]
        yield Batch(np.empty((0, 2 + len(self.about["signals"]))), pending)


def difference(parts: Iterable[Any], last: bool) -> int | None:
    """Return the drain minus the row of a frame after the first row; None without one.

    parts : arrays of FRAME
    last : whether it is the last such frame of the first array that has one; else the first one
    """
    for frames in parts:
        after = frames[frames["row"] > 0]
        if len(after):
            frame = after[-1 if last else 0]
            return int(frame["drain"]) - int(frame["row"])
    return None
