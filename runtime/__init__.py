"""Runs a schedule on a rig or in simulation: life cycle, buses, recorder, command line."""


def load(path):
    """A recording, read back; or several, as one table. Needs NumPy and mcap, and nothing that was compiled.

    load("trial.mcap")          runtime.analysis.trial.Trial: `trial["left/knee.position"]` is an array over the ticks
    load("trials/*.mcap")       runtime.analysis.trials.Trials: all of them below each other, with the fields of each
    trial

    path : of a file; a pattern; or a list of paths. BadInput where there is no such recording.
    """
    from runtime.analysis.trials import load

    return load(path)
