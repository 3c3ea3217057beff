"""A second process that stands by, and takes the first one's place when that dies.

The recorder forks it once its files are open. Before each release of the ring the recorder sends it a will: how far the ring will be released,
how long every file is then, and what the services know by then. The ring gives nothing back before, so that with the last will that came true its
heir knows to the byte what is in the files: it cuts off what is beyond, and records from there on into files of its own, the next part. Nothing is
lost and nothing comes twice, unless the ring was full meanwhile. An heir that dies is replaced.
"""

import json
import os
import select
import socket

DONE = b"done"
LONGEST = 1 << 16               # bytes of a will


class Heir:
    """The process that stands by, as the recorder sees it.

    page : Page
    sizes : of every file, {path: bytes}, as flushed when it is made
    states : of the services, bytes
    """

    def __init__(self, page, sizes, states):
        self.page = page
        self.drawers = [os.memfd_create("tickwork-states") for _ in range(2)]      # for the newest will and for the one before
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        first = self.will(sizes, states)
        self.pid = os.fork()
        if self.pid == 0:
            self.socket.close()
            call_oneself("tickwork-heir")
            raise Inherited(self.opened(wait(theirs, first, page)))
        theirs.close()
        page.release()

    def will(self, sizes, states):
        drawer = self.drawers.pop(0)
        self.drawers.append(drawer)
        try:
            kept = os.pwrite(drawer, states, 0)
        except OSError:                     # no memory: what the services know dies with this process
            kept = 0
        return json.dumps({
            "tail": self.page.cursor, "sizes": sizes, "dropped": self.page.statistics()["dropped"],
            "drawer": drawer if kept == len(states) else None, "bytes": kept}).encode()

    def opened(self, will):
        """In the heir: a will with the states that belong to it."""
        states = os.pread(will["drawer"], will["bytes"], 0) if will["drawer"] is not None else b""
        self.close_drawers()
        return {**will, "states": states}

    def close_drawers(self):
        for drawer in self.drawers:
            os.close(drawer)

    def release(self, sizes, states):
        """Give the drained part of the ring back, once the heir has the will. False: it has died."""
        try:
            self.socket.send(self.will(sizes, states))
        except BlockingIOError:             # it was stopped by somebody: it will find one part longer than it should be, and leave it
            pass
        except OSError:
            return False
        self.page.release()
        return True

    def dismiss(self):
        """All is written: nobody needs to take over."""
        try:
            self.socket.send(DONE)
        except OSError:
            pass
        self.bury()

    def bury(self):
        self.socket.close()
        self.close_drawers()
        try:
            os.waitpid(self.pid, 0)
        except ChildProcessError:
            pass


class Inherited(Exception):
    """Raised in the heir when it has to take over. will : the last one that came true, as a dict"""

    def __init__(self, will):
        super().__init__(will)
        self.will = will


def wait(end, first, page):
    """In the heir: until the recorder has died; its will. Ends the process when it is no longer needed."""
    known = [json.loads(first)]
    poll = select.poll()
    poll.register(end, select.POLLIN)
    while True:
        poll.poll()
        try:
            word = end.recv(LONGEST)
        except BlockingIOError:
            continue
        except OSError:
            word = b""
        if word == DONE:
            os._exit(0)
        if not word:
            end.close()
            tail = page.tail
            return next((one for one in reversed(known) if one["tail"] == tail), {**known[-1], "sizes": {}, "drawer": None})
        known = [known[-1], json.loads(word)]


def call_oneself(name):
    with open("/proc/self/comm", "w") as file:
        file.write(name)
