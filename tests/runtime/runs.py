"""Runs of the command line in a process of their own, what they leave behind, and what they send."""

import atexit
import functools
import gc
import itertools
import json
import os
import queue
import socket
import subprocess
import sys
import threading
import time
from collections import Counter
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import numpy as np

import runtime
from runtime.record.storage.format import Frame
from tests.blocks.actuators import reference
from tests.runtime.forked import Forked, Server

STARTING = threading.Lock()  # of the server: `cache` alone starts one for each thread
ROOT = Path(__file__).resolve().parents[2]
KNEE_EXO = ROOT / "diagrams" / "knee_exo.py"
AK10_9 = reference.ranges(velocity=50.0, torque=65.0)
TORQUE_STEP = 130.0 / 4095  # N·m, a code of torque
ENABLE, DISABLE = "FFFFFFFFFFFFFFFC", "FFFFFFFFFFFFFFFD"
NOTHING = "7FFF7FF0000007FF"  # position, velocity and torque in the middle, no stiffness, no damping

# A robot in few lines. `law` says what its knee is told to do: the body of a step that has `position`, `velocity`, `t`
# and `tick`.
KNEE = '''
import math

from blocks.actuators import CubeMars
from blocks.limiters import TorqueLimiter
from blocks.recorders import CsvRecorder
from graph import Block, Diagram, Input, Output


class Law(Block):
    """What the knee is told to do."""

    position = Input("rad")
    velocity = Input("rad/s")
    torque = Output("N·m")

    def step(self, position, velocity, t, tick):
        {law}


with Diagram("knee", rate=200) as diagram:
    knee = CubeMars("AK10-9-V2.0", bus="legs", can_id=1, range=(-12.5, 12.5), wake_shift=0.0, name="knee")
    torque = Law(name="law")(knee.position, knee.velocity)
    knee(torque_command=TorqueLimiter(limit=5.0)(torque))
    CsvRecorder()
'''


def write(folder, text, name="robot.py"):
    """A diagram file. Returns its path."""
    path = Path(folder) / name
    path.write_text(text)
    return path


def knee(folder, law="return 2.0 * math.sin(5.0 * t)"):
    return write(folder, KNEE.format(law=law))


def line_of(path, text):
    """Number of the line of a file that holds a text."""
    return next(number for number, line in enumerate(Path(path).read_text().splitlines(), 1) if text in line)


def environment(**more):
    """As in an activated environment, from wherever."""
    path = os.pathsep.join([os.path.dirname(sys.executable), os.environ["PATH"]])
    ours = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    return ours | {"PATH": path, "PYTHONPATH": str(ROOT), "LC_ALL": "C.UTF-8"} | more


def finished(*arguments, cwd, timeout=60, cold=False, limits=None, **more):
    """A run from beginning to end. Returns the CompletedProcess, with text. limits : of Forked"""
    with started(*arguments, cwd=cwd, cold=cold, limits=limits, env=environment(**more)) as process:
        try:
            out, err = process.communicate(timeout=timeout)
        except BaseException:
            process.kill()
            raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)


def started(*arguments, cwd, cold=False, **how):
    """A run that has been started. Returns the Popen, with text. cold : in an interpreter that starts with it"""
    how = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **how}
    return module("runtime", *arguments, cwd=cwd, cold=cold, text=True, **how)


def module(name, *arguments, cwd=ROOT, cold=False, limits=None, **how):
    """Start a module in a forked process, or in an interpreter that starts with it. Returns the Popen."""
    words, how = ["-m", name, *map(str, arguments)], {"env": environment(), **how}
    if cold or "preexec_fn" in how or not server().serves(how["env"]):
        assert limits is None
        return subprocess.Popen([sys.executable, *words], cwd=cwd, **how)
    return Forked(server(), words, limits, cwd=cwd, **how)


def server():
    """Process that forks runs, the same until the tests end."""
    with STARTING:
        return only_server()


@functools.cache
def only_server():
    server = Server(environment())
    atexit.register(server.close)
    return server


def forked(words, env=None, **how):
    """A Python with `-c` that is forked, or with `-m`. Returns the Popen."""
    variables = os.environ if env is None else env
    return Forked(
        server(),
        words[1:],
        env={name: value for name, value in variables.items() if not name.startswith("PYTHON")},
        **how,
    )


FORKING = SimpleNamespace(**{**vars(subprocess), "Popen": forked})


def writer_of(pid):
    """Number of the process below another that writes its recording; None where there is none yet."""
    return descendant(pid, "tickwork-record")


def descendant(pid, word):
    """Number of the process below another with a name, or a word in its command line; None where there is none."""
    for child in below(pid):
        with suppress(OSError):
            words, name = (Path(f"/proc/{child}/{file}").read_bytes() for file in ("cmdline", "comm"))
            here = word.encode() in words or name.strip() == word.encode()
            if here and Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[0] != "Z":
                return child
    return None


def below(pid):
    """Numbers of the processes that another has started, and those that they have started."""
    with suppress(OSError):
        for thread in os.listdir(f"/proc/{pid}/task"):
            for child in map(int, Path(f"/proc/{pid}/task/{thread}/children").read_text().split()):
                yield child
                yield from below(child)


def open_files():
    """Counter of the files of this process: `open_files() - before` are those that have been opened and not closed.

    Without sockets: the threads of a library that another test has used open and close theirs at any time.
    """
    gc.collect()
    links = []
    for number in os.listdir("/proc/self/fd"):
        with suppress(OSError):  # that of the listing
            links.append(os.readlink(f"/proc/self/fd/{number}"))
    return Counter(link for link in links if not link.startswith(("socket:", "anon_inode:[event")))


def stamps(datagrams):
    """When each was taken: s since the first of them. Doubles of s since 1970 tell a quarter of a microsecond."""
    times = [datagram["timestamp"] for datagram in datagrams]
    assert times == sorted(set(times)) and abs(times[0] - time.time()) < 600.0
    return [at - times[0] for at in times]


class Listener:
    """Listens where PlotJuggler would: `address` for --plotjuggler, then datagrams as parsed JSON.

    A thread takes them as they come: what the system keeps of unread datagrams can be little.
    """

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.socket.getsockname()[1]}"
        self.arrived = queue.SimpleQueue()
        self.thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *exception):
        self.rest()
        self.socket.close()

    def _listen(self):
        while datagram := self.socket.recv(65536):
            self.arrived.put(datagram)

    @property
    def dropped(self):
        """Datagrams that the system has dropped because nobody took them in time, as on a busy machine."""
        port = f":{self.socket.getsockname()[1]:04X}"
        lines = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
        return sum(int(words[-1]) for words in lines if words[1].endswith(port))

    def wait(self, count, timeout=30.0):
        """The next `count` datagrams."""
        return [self._parse(self.arrived.get(timeout=timeout)) for _ in range(count)]

    def rest(self):
        """All that have arrived and were not yet taken, once nobody sends any more. Ends the listening."""
        if self.thread.is_alive():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as last:  # an empty datagram, behind all others
                last.sendto(b"", self.socket.getsockname())
            self.thread.join(10)
        found = []
        while not self.arrived.empty():
            found.append(self._parse(self.arrived.get()))
        return found

    @staticmethod
    def _parse(datagram):
        def refuse(constant):
            raise ValueError(f"{constant} is not JSON")

        return json.loads(datagram, parse_constant=refuse)


class Files:
    """What one run has left in a folder of recordings."""

    def __init__(self, folder):
        self.folder = Path(folder)

    @property
    def names(self):
        return sorted(path.name for path in self.folder.iterdir())

    def one(self, ending):
        [path] = self.folder.glob(f"*{ending}")
        return path

    @property
    def sidecar(self):
        return json.loads(self.one(".json").read_text())

    @property
    def header(self):
        return self.one(".csv").read_text().split("\n", 1)[0].split(",")

    @property
    def table(self):
        """Columns of the CSV file by their header."""
        lines = self.one(".csv").read_text().splitlines()[1:]
        rows = np.array([line.split(",") for line in lines], dtype=float).reshape(len(lines), len(self.header))
        return dict(zip(self.header, rows.T))

    @property
    def frames(self):
        """(time in s, bus, id, data as hex digits, whether we sent it) of every frame of the recording."""
        trial = runtime.load(self.one(".mcap"))
        frames = [(item, Frame.unpack(item.payload)) for item in trial.frames]
        return [
            (round((trial.began + item.time) * 1e-9, 6), item.bus, frame.id, frame.data.hex().upper(), item.sent)
            for item, frame in frames
        ]

    def sent(self, can_id):
        """Data of the frames that we sent to one id, in their order."""
        return after_asking([data for _, _, identifier, data, ours in self.frames if ours and identifier == can_id])


def after_asking(sent):
    """Data sent to a drive in MIT mode, without those with which arming asks it before it is enabled."""
    return list(itertools.dropwhile(lambda data: data == DISABLE, sent))


def torque_of(data):
    """N·m of a command frame, as an AK10-9 understands it."""
    return reference.read_command(AK10_9, bytes.fromhex(data))["torque"]


def assert_safely_stopped(files, can_ids):
    """Enable and zero torque came first, zero torque and then disable last, on every actuator."""
    for can_id in can_ids:
        sent = files.sent(can_id)
        assert sent[:2] == [ENABLE, NOTHING]
        assert sent[-2:] == [NOTHING, DISABLE]
        assert DISABLE not in sent[: sent.index(DISABLE)] and set(sent[sent.index(DISABLE) :]) <= {NOTHING, DISABLE}
