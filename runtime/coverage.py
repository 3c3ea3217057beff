"""Which failures of a run end in the safe stop of a bus all the same, and who sees to it."""

GUARDIAN, WATCHDOG, RUN, DRIVES = "the guardian", "the watchdog, then the guardian", "the run itself", "the drives' own time-out"


def coverage(devices):
    """Of one bus on a rig: a list of {"failure", "covered", "by"}. `by` says who sees to it, or why nobody does.

    devices : graph.Device that are on it; of a bus with nothing to stop the list is empty
    """
    movers = [device for device in devices if device.disable_frames() or device.zero_frames()]
    if not movers:
        return []
    alone = [device.path for device in movers if device.own_timeout is None]
    power = DRIVES if not alone else f"no time-out of its own is known of {', '.join(alone)}"
    return [
        entry("exception", RUN), entry("kill -9", GUARDIAN), entry("kill -STOP", GUARDIAN), entry("hung block", WATCHDOG),
        entry("loss of the guardian", RUN), entry("loss of power of the computer", power, covered=not alone),
    ]


def entry(failure, by, covered=True):
    return {"failure": failure, "covered": covered, "by": by}


def in_words(found):
    """(what is covered, what is not), as texts; '' for none. found : as `coverage` gives it"""
    by = {}
    for each in found:
        by.setdefault((each["covered"], each["by"]), []).append(each["failure"])
    texts = {covered: "; ".join(f"{', '.join(failures)} ({who})" for (is_so, who), failures in by.items() if is_so == covered)
             for covered in (True, False)}
    return texts[True], texts[False]
