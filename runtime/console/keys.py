"""The keys of the run's terminal: read one by one, without echo, while the run is in the foreground; then put back as
it was.

The recorder process reads them through a descriptor that the control process has opened, for it has no terminal of its
own. So job control does not hold it back, and it must hold back by itself: a shell that has taken the terminal over
gets every key. Whoever puts the terminal back does so only if it is still as we have set it: else somebody else has it
by now.
"""

import os
import re
import select
import termios

STDIN, STDOUT = 0, 1
# of what tcgetattr gives: indices of local flags and of characters
LINE_MODE, LOCAL, CHARACTERS = termios.ICANON | termios.ECHO, 3, 6

NAMES = {b" ": "space", b"\t": "tab", b"\x1b[Z": "shift tab", b"\n": "enter", b"\r": "enter"}
# how their sequences end, whatever is held down with them
ARROWS = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
KEY = re.compile(rb"\x1b\[[0-9;]*[A-Za-z~]|\x1bO[A-Za-z]|\x1b[^\x1b[O]|[^\x1b]", re.DOTALL)
LONGEST = 32  # bytes of an unfinished sequence, beyond which it is none


def own_terminal():
    """A descriptor of the terminal that this process reads and writes, to be passed on; None where there is none, or it
    is another's.
    """
    if not (os.isatty(STDIN) and os.isatty(STDOUT)):
        return None
    try:
        os.tcgetpgrp(STDIN)  # only of the terminal that its jobs are controlled by
        return os.open("/dev/tty", os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError:
        return None


def key_mode(attributes):
    """What tcgetattr gives, for single keys without echo. Ctrl-C still interrupts, and no key is not the end of the
    file for others.
    """
    changed = [*attributes[:CHARACTERS], list(attributes[CHARACTERS])]
    changed[LOCAL] &= ~LINE_MODE
    changed[CHARACTERS][termios.VMIN], changed[CHARACTERS][termios.VTIME] = 1, 0
    return changed


def attributes_of(descriptor):
    """What a terminal is set to; None where there is none any more."""
    try:
        return termios.tcgetattr(descriptor)
    except termios.error:
        return None


def put_back(descriptor, attributes):
    """Give a terminal these attributes, if it is in the key mode of them."""
    try:
        if termios.tcgetattr(descriptor) == key_mode(attributes):
            termios.tcsetattr(descriptor, termios.TCSANOW, attributes)
    except termios.error:  # it has gone away
        pass


class Keyboard:
    """
    descriptor : of the terminal, as own_terminal gives it
    process : number of the process whose terminal it is
    here : the run was in the foreground when `follow` last looked
    taken : the keys are ours
    """

    def __init__(self, descriptor, process):
        self.descriptor, self.process = descriptor, process
        self.here = self.taken = False
        self.attributes = None  # the terminal's own
        self.unread = b""
        self.poll = select.poll()
        self.poll.register(descriptor, select.POLLIN)

    def foreground(self):
        """Whether the process is what the terminal's person now talks to, and runs."""
        try:
            with open(f"/proc/{self.process}/stat") as file:
                state, _, group, _, _, terminal_group = file.read().rpartition(")")[2].split()[:6]
        except OSError:
            return False
        return group == terminal_group and state not in "TZX"

    def follow(self):
        """Take the terminal when the run comes to the foreground, give it back when it has left."""
        try:
            self.here = self.foreground()
            if not self.here:
                self.close()
                return
            now = termios.tcgetattr(self.descriptor)
            # else a shell has put it back into our mode
            if self.attributes is None or now != key_mode(self.attributes):
                termios.tcsetattr(self.descriptor, termios.TCSANOW, key_mode(now))
                self.attributes = now
            if not self.taken:
                termios.tcflush(self.descriptor, termios.TCIFLUSH)  # typed before, so not meant for us
                self.taken = True
        except termios.error:  # it has gone away
            self.taken = False

    def read(self):
        """Names of the keys pressed since the last time: "space", "tab", "shift tab", "enter", "up", "down", "left",
        "right", or a character.
        """
        if not self.taken:
            return []
        try:
            [(_, state)] = self.poll.poll(0) or [(0, 0)]
            if state & select.POLLIN and self.foreground():
                self.unread += os.read(self.descriptor, 4096)
        except BlockingIOError:  # somebody else has read it
            pass
        except OSError:  # it has gone away
            self.taken = False
        keys, end = [], 0
        while match := KEY.match(self.unread, end):
            keys.append(name(match[0]))
            end = match.end()
        self.unread = self.unread[end:] if len(self.unread) - end < LONGEST else b""
        return keys

    def close(self):
        """Put the terminal back as it was."""
        if self.taken:
            put_back(self.descriptor, self.attributes)
            self.taken = False


def name(sequence):
    if sequence in NAMES:
        return NAMES[sequence]
    if len(sequence) > 2 and sequence[:1] == b"\x1b":
        return ARROWS.get(sequence[-1:], "")
    return sequence.decode("ascii", "replace")
