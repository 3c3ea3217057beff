"""Read recordings for commands, with progress and problems on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.console.terminal import print_to_stderr
from runtime.record.analysis.trial import Trial

if TYPE_CHECKING:
    from pathlib import Path

    from runtime.host.console.progress import Progress


def read(path: Path, progress: Progress, first: float, last: float) -> Trial:
    """Open a recording, check it and report any damage. Returns a Trial.

    progress : runtime.host.console.progress.Progress
    first, last : share of the progress before and after the check

    Raises BadInput if the file is not a recording.
    """
    trial = Trial(path)
    trial.check(progress.part(first, last))
    if trial.trouble:
        progress.terminal.erase()
        until = f", {len(trial)} ticks until {trial.time[-1]:g} s" if len(trial) else ", no ticks"
        print_to_stderr([f"tickwork: {trial.trouble}{until}"])
    elif trial.unverified:
        print_to_stderr([f"tickwork: {trial.unverified} ticks of {trial.path} are not verified by a checksum"])
    return trial
