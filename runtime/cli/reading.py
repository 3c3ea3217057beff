"""Recordings as commands read them: how far that is shows on the terminal, and what is the matter with a file is
told.
"""

from runtime.analysis.trial import Trial
from runtime.console.terminal import complain


def read(path, progress, first, last):
    """A Trial. progress : runtime.console.progress.Progress; first, last : the shares of the whole that it goes from
    and to. BadInput
    """
    trial = Trial(path, progress.part(first, last))
    if trial.trouble:
        progress.terminal.erase()
        until = f", {len(trial)} ticks until {trial.time[-1]:g} s" if len(trial) else ", no tick"
        complain([f"tickwork: {trial.trouble}{until}"])
    return trial
