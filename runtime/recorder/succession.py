"""A second process that stands by, and takes the first one's place when that dies.

The recorder forks it once its files are open. Before each release of the ring the recorder sends it a will: how far the ring will be released,
and how long every file is then. The ring gives nothing back before, so that with the last will that came true its heir knows to the byte what is
in the files: it cuts off what is beyond, and records from there on into files of its own, the next part. Nothing is lost and nothing comes twice,
unless the ring was full meanwhile. An heir that dies is replaced.
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
    """

    def __init__(self, page, sizes):
        self.page = page
        self.socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
        first = will(page.cursor, sizes, page)
        self.pid = os.fork()
        if self.pid == 0:
            self.socket.close()
            call_oneself("tickwork-heir")
            raise Inherited(wait(theirs, first, page))
        theirs.close()
        page.release()

    def release(self, sizes):
        """Give the drained part of the ring back, once the heir has the will. False: it has died."""
        try:
            self.socket.send(will(self.page.cursor, sizes, self.page))
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
        try:
            os.waitpid(self.pid, 0)
        except ChildProcessError:
            pass


class Inherited(Exception):
    """Raised in the heir when it has to take over. will : the last one that came true, as a dict"""

    def __init__(self, will):
        super().__init__(will)
        self.will = will


def will(tail, sizes, page):
    return json.dumps({"tail": tail, "sizes": sizes, "dropped": page.statistics()["dropped"]}).encode()


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
            return next((one for one in reversed(known) if one["tail"] == tail), {**known[-1], "sizes": {}})
        known = [known[-1], json.loads(word)]


def call_oneself(name):
    with open("/proc/self/comm", "w") as file:
        file.write(name)
