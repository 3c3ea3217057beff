"""Counts of frames in the summary of a run on a rig."""

from types import SimpleNamespace

from runtime.robot.rig.buses import RigBuses


def test_error_frames_are_not_subtracted_from_frames_that_were_received():
    """They may come while nothing reads the bus, such as between arming and the begin of the run."""
    rig = SimpleNamespace(
        media={"legs": "can"},
        after={"legs": {"errors": 900, "strangers": 4, "refused": 0, "echoes": 1, "corrupt": 0, "overflows": 2}},
    )
    counts = RigBuses.correct(rig, {"sent": 10, "received": 6, "foreign": 0, "malformed": 0})
    kept = {"errors": 900, "refused": 0, "echoes": 1, "corrupt": 0, "overflows": 2}
    assert counts == {"sent": 10, "received": 10, "foreign": 4, "malformed": 0} | kept
