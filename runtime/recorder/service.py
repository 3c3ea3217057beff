"""What serves a sink in the recorder process. A lab adds its own by naming it: `service = "my_package.mine:MyService"`
in a Sink.

The recorder calls, in this order and from one thread:

    __init__(plan, sink)        as runtime.recorder describes them; plan["stem"] is free in plan["folder"]
    open()                      create files, resolve hosts; an exception here means that the run does not begin
    row(tick, time, values)     every completed tick: int, s, and a float for each of sink["columns"], in their order
    event(event)                what happened besides, as the sidecar keeps it: a dict
    flush()                     at least once a second, and before close
    close()                     returns what the report shall say of this sink: a dict that JSON can carry
    conclude(plan, services)    on the class, once, with all its closed services: what they make together, a dict for
    the report

`page` is that of the run, and `say` is there to be called with a line that the person at the terminal shall read; a
`problem` in what close() returns is told, too. `files` maps the path of each file the service has made to a remark on
it. While open() or row() works the ring waits, and a full ring drops records: a service must never block. One that
raises is stopped and reported; the run and the others go on.
"""

import time
from importlib import import_module


class Service:
    elsewhere = False  # whether another process writes its files

    def __init__(self, plan, sink):
        self.plan, self.sink = plan, sink
        self.files = {}
        self.say, self.page = (lambda line: None), None

    def epoch(self):
        """s since 1970 at tick 0, by the clock of the computer, once the first row has come."""
        return time.time() if self.page is None else (self.page.wall + self.page.first_tick) * 1e-9

    def open(self):
        pass

    def row(self, tick, time, values):
        pass

    def event(self, event):
        pass

    def flush(self):
        pass

    def close(self):
        return {}

    @classmethod
    def conclude(cls, plan, services):
        return {}


def find(name):
    """The class behind "module:class". ImportError or AttributeError where there is none."""
    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)
