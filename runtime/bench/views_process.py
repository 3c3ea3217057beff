"""One chunk of `bench views`, in a process of its own, so that it shares no interpreter with another: `python -m
runtime.bench.views_process ...`.
"""

import json
import sys

from runtime.bench import views
from runtime.machine.realtime import RealtimeRefused
from runtime.recorder import RecorderError


def main(name, seconds, realtime, folder, port):
    """A line of JSON: `lateness` and `period` as counts, `ticks`, `missed`, `dropped`, `problems`; or `refused`, and
    why.
    """
    try:
        result = views.chunk(name == views.ALL, float(seconds), realtime, folder, int(port))
    except (RealtimeRefused, RecorderError) as error:
        told = {"refused": str(error)}
    else:
        told = {what: result.page.counts(what).tolist() for what in ("lateness", "period")}
        told |= {what: result.statistics[what] for what in ("ticks", "missed", "dropped")} | {
            "problems": result.recording["problems"]
        }
    print(json.dumps(told))


if __name__ == "__main__":
    main(*sys.argv[1:])
