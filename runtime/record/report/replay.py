"""Lines of a replay for standard output."""

from typing import Any

from runtime.record.storage.grouping import PLAIN

REPORT_LINES = 3  # of the recorded report of a fault: its name, place and cause


def text(result: Any) -> list[str]:
    """Return the lines of a runtime.session.replay.Replayed for standard output."""
    there, comparison = result.there, result.comparison
    diagram = "the recorded diagram" if result.unchanged else "a changed diagram"
    lines = [f"{there.about['name']}: {comparison.ticks} ticks of {there.path.name} replayed with {diagram}"]
    if result.source.file is None:
        lines.append(
            f"  the diagram in the recording was used: {result.source.instead}. Pass --diagram FILE to use a file"
        )
    if result.fault is not None:
        lines.append(f"  replayed up to the fault at tick {result.fault}, after which the run waited to be armed again")
    if not there.complete:
        lines.append("  the recording is incomplete; replayed up to its last complete tick")
    signals = len(comparison.same) + len(comparison.differences)
    if result.same:
        lines.append(f"  all {signals} signals and {result.frames} sent frames are the same, bit for bit")
    if result.ended_externally:
        lines.append(
            f"  the recorded run ended by an external cause, which a replay does not repeat: {result.end['status']}"
        )
    if comparison.differences:
        first = comparison.differences[0]
        unit = "" if first.unit in PLAIN else f" {first.unit}"
        lines.append(
            f"  first difference: {first.path} at tick {first.first}: recorded {first.here!r}, "
            f"replayed {first.there!r}{unit}"
        )
        lines.append(
            f"  {len(comparison.differences)} of {signals} signals differ, {len(comparison.same)} are the same"
        )
    if result.frame is not None:
        lines.append(f"  the sent frames differ from index {result.frame} of {result.frames}")
    for label, paths in (
        ("only in the recording", comparison.only_here),
        ("only in the replay", comparison.only_there),
    ):
        if paths and not (result.context and paths is comparison.only_there):  # which has every signal
            lines.append(f"  {label}: {', '.join(paths[:5])}{f' and {len(paths) - 5} more' if len(paths) > 5 else ''}")
    if any(comparison.missing):
        lines.append(
            f"  {comparison.missing[0]} ticks are only in the recording, {comparison.missing[1]} only in the replay"
        )
    if not result.ended_alike:
        lines.append(
            f"  different end: recorded {end(result.end['status'], result.end['culprit'])}, "
            f"replayed {end(result.outcome.status, result.outcome.culprit)}"
        )
    lines += [f"  {path}" for path in result.files]
    if not result.context:
        return lines
    tick = result.fault if result.fault is not None else result.end.get("tick", result.outcome.tick)
    how = end(result.end["status"], result.end["culprit"]) if result.end else "the recording does not state how"
    when = f"tick {tick} ({tick / result.there.about['rate']:g} s)"
    report = [line for line in result.end.get("report", ()) if not line.startswith("  ticks")][:REPORT_LINES]
    head = report or [f"the run ended: {how}, {when}"]
    return [*lines, *head, *result.context]


def end(status: str, culprit: str | None) -> str:
    """Return the end of a run as text. culprit : block or device, None without one"""
    return status if culprit is None else f"{status} at {culprit}"
