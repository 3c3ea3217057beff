"""A recording whose recorder was killed: the parts in which others went on, as one.

Part 2 of `trial.mcap` is `trial_part2.mcap` beside it, and so on: together they hold every tick, none twice.
"""

import re
from dataclasses import dataclass, replace
from pathlib import Path

from runtime.base.errors import BadInput
from runtime.recording import messages

PART = re.compile(r"(.+)_part(\d+)")


@dataclass(frozen=True)
class Seam:
    """Where the next part goes on.

    rows : how many are complete before it; what there is more in the parts before does not count
    since : ns of the files, frames of the parts before do not count from then on; None where all do
    drains, drained : of the buses before it, and ns of the files when the last was
    """

    rows: int
    since: int | None
    drains: int
    drained: int


def heads(paths):
    """[Path]: those that do not go on with another one among them."""
    paths = [Path(path) for path in paths]
    names = {(path.parent, path.stem) for path in paths}
    return [
        path for path in paths if (found := PART.fullmatch(path.stem)) is None or (path.parent, found[1]) not in names
    ]


def whole(path, read, progress):
    """(what was read of the file and of the parts that go on with it, [Path] of all of them).

    read : called with a path and a progress; returns a runtime.recording.reader.Reader. BadInput
    """
    first, number, paths = read_first(path, read, progress)
    stem = path.stem.removesuffix(f"_part{number}") if number > 1 else path.stem
    while (following := path.with_name(f"{stem}_part{number + 1}{path.suffix}")).exists():
        number += 1
        try:
            second = read(following, progress)
        except BadInput:  # its recorder was killed, too, before its first tick
            continue
        if second.about.get("part") != number or not are_of_one_run(first, second):
            break  # of another run that had the same name
        join(first, second)
        paths.append(following)
    return first, paths


def read_first(path, read, progress):
    """(what was read, the number of the part, [its Path]). An empty file's recorder died at once: the next part begins
    where it should have.
    """
    following = path.parent / f"{path.stem}_part2{path.suffix}"
    if following.exists() and path.exists() and path.stat().st_size == 0:
        first = read(following, progress)
        first.about = {**first.about, "part": 1}
        return first, 2, [following]
    first = read(path, progress)
    return first, first.about.get("part", 1), [path]


def is_unbegun(reader):
    """Return whether the recorder of a part was killed before it wrote the begin of the run."""
    return not any(event["event"] == "begin" for event in reader.events)


def are_of_one_run(first, second):
    """Return whether two parts agree in diagram, signals and, where the first one has it, the start of the run."""
    here, there = (
        (part.about.get("hash"), [signal["path"] for signal in part.about["signals"]]) for part in (first, second)
    )
    return here == there and (is_unbegun(first) or first.began == second.began)


def join(first, second):
    """Lengthen what was read of a part by the next one."""
    unbegun = is_unbegun(first)
    if unbegun:
        first.began = second.began
    rows, since = keep(first, second)
    offset = drains_before(first.frames, second.frames, rows)
    drained = first.frames[-1].drained if first.frames else 0
    first.seams.append(Seam(rows, since, offset, first.began + drained))
    for frame in second.frames:
        first.frames.append(
            replace(
                frame,
                drain=frame.drain + offset,
                row=frame.row + rows,
                drained=frame.drained if frame.drain else drained,
            )
        )
    for topic in {**first.messages, **second.messages}:
        first.messages[topic] = first.messages.get(topic, [])[:rows] + second.messages.get(topic, [])
    first.events += [event for event in second.events if unbegun or event["event"] != "begin"]
    first.end, first.finished, first.trouble = second.end, second.finished, second.trouble


def keep(first, second):
    """How many rows of a part to keep: those before the next one begins. A recorder that was stopped before it was
    killed leaves more.

    Returns (rows, as Seam has `since`).
    """
    kept = first.messages[messages.ROW_END]
    if second.messages[messages.ROW_END]:
        begins = number_of(second.messages[messages.ROW_END][0])
        beyond = next((row for row, data in enumerate(kept) if number_of(data) >= begins), len(kept))
        if beyond < len(kept):
            since = second.frames[0].time if second.frames else None
            first.frames = [
                frame for frame in first.frames if frame.row <= beyond and (since is None or frame.time < since)
            ]
            return beyond, None if since is None else second.began + since
    return len(kept), None


def number_of(row):
    return messages.read(messages.TICK, row)["tick"]


def drains_before(frames, following, rows):
    """How many drains of the buses there were before a part whose count begins anew: there is one a row. rows : of what
    stands before it
    """
    here = next((frame.drain - frame.row for frame in reversed(frames) if frame.row > 0), None)
    there = next((frame.drain - frame.row for frame in following if frame.row > 0), None)
    if here is None or there is None:
        return max((frame.drain for frame in frames), default=0)
    return here + rows - there
