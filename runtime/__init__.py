"""Runs a schedule on a rig or in simulation: life cycle, buses, recorder, command line."""


def load(path):
    """A recording, as runtime.recordings.trial.Trial: `load("trial.mcap")["left/knee.position"]` is an array over the ticks."""
    from runtime.recordings.trial import Trial

    return Trial(path)
