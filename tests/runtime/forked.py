"""Processes that are forked from one that has imported what a run and its recorder import.

Each has the arguments, folder, environment, limits and files it is given, as one that is started, but is ready after
20 ms instead of 350 ms. A new session is controlled by the terminal of its standard error. The recorder of a forked
run is forked from it; its guardian is started as ever: forked from it, a guardian was late on a busy machine. What
depends on the start of the interpreter needs a `subprocess.Popen`.
"""

import atexit
import fcntl
import gc
import json
import os
import resource
import runpy
import select
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

from runtime.host import child_process
from tests.runtime.stuck import ask_for_stacks, show_stack_on_signal

IMPORTED = (
    "PIL.GifImagePlugin",
    "PIL.JpegImagePlugin",
    "PIL.PpmImagePlugin",
    "blocks.families",
    "blocks.filters",
    "blocks.limiters",
    "blocks.models",
    "blocks.recorders",
    "blocks.sources",
    "can.interfaces.udp_multicast",
    "concurrent.futures.thread",
    "encodings.idna",
    "google.protobuf.descriptor_pb2",
    "graph.drawing.compose",
    "graph.order",
    "mcap.stream_reader",
    "mcap.writer",
    "runtime.cli.check",
    "runtime.cli.convert",
    "runtime.cli.emulate",
    "runtime.cli.plot",
    "runtime.cli.run",
    "runtime.cli.scan",
    "runtime.record.analysis.plots",
    "runtime.record.analysis.stride_picture",
    "runtime.record.recorder.local",
    "runtime.record.recorder.process",
    "runtime.record.recorder.services.candump",
    "runtime.record.recorder.services.csv",
    "runtime.record.recorder.services.mcap",
    "runtime.record.recorder.services.panel",
    "runtime.record.recorder.services.plotjuggler",
    "runtime.record.recorder.services.strides",
    "runtime.record.report.summary",
    "runtime.robot.guardian.process",
    "runtime.robot.loading.simulation",
    "runtime.robot.rig.verifier",
    "runtime.session.prepare",
    "runtime.session.session",
    "segno",
    "xml.etree.ElementTree",
)
RECORDER = "runtime.record.recorder.process"
READ_AT_START = ("LANG", "LC_", "MALLOC_", "OPENBLAS_", "PYTHON")  # starts of names of environment variables
STATUS = struct.Struct("i")
MESSAGE_LIMIT = 1 << 17  # bytes
FILES_LIMIT = 64


class Forked(subprocess.Popen):
    """Popen of a Python that `server` forks instead of starting it.

    words : ["-m", module, *arguments] or ["-c", code, *arguments]
    limits : {name of a resource limit: its value}
    how : of subprocess.Popen, with `env`
    """

    def __init__(self, server, words, limits=None, **how):
        self._server, self._limits = server, limits or {}
        super().__init__(words, **how)

    def _execute_child(self, words, *how):
        request, files, pipes = request_of(words, how, self._limits)
        status, their_status = os.pipe()
        self.pid = self._server.fork(request, [their_status, *files])
        self._status, self._child_created = status, True
        os.close(their_status)
        self._close_pipe_fds(*pipes)

    def communicate(self, input=None, timeout=None):
        """As of Popen. Where patience is over, the error has the stacks of the processes as a note."""
        try:
            return super().communicate(input, timeout)
        except subprocess.TimeoutExpired as error:
            threads = ask_for_stacks(self)
            with suppress(subprocess.TimeoutExpired):
                super().communicate(timeout=0.1)
            written = b"".join((self._fileobj2output or {}).get(self.stderr, ()))
            add_note(error, f"{threads}\n{written.decode(errors='replace')}")
            raise

    def _try_wait(self, flags):
        if not select.select([self._status], [], [], 0.0 if flags else None)[0]:
            return 0, 0
        code = os.read(self._status, STATUS.size)
        os.close(self._status)
        return self.pid, STATUS.unpack(code)[0]

    def _internal_poll(self, *ignored, **also_ignored):
        if self.returncode is None and self._waitpid_lock.acquire(False):
            try:
                pid, status = self._try_wait(os.WNOHANG) if self.returncode is None else (0, 0)
                if pid == self.pid:
                    self._handle_exitstatus(status)
            finally:
                self._waitpid_lock.release()
        return self.returncode


def add_note(error, text):
    if hasattr(error, "add_note"):  # from Python 3.11 on
        error.add_note(text)


class ForkedRecorder(subprocess.Popen):
    """Popen in a forked run: it forks a recorder from this process, and starts everything else as ever."""

    def _execute_child(self, words, *how):
        if RECORDER not in words:
            return super()._execute_child(words, *how)
        request, files, pipes = request_of(words[1:], how)
        self.pid = os.fork()
        if self.pid == 0:
            try:
                end_quickly(lambda: carry_out(**request, files=files, controlled=False))
            except SystemExit as error:
                print(error.code, file=sys.stderr, flush=True)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        self._child_created = True
        self._close_pipe_fds(*pipes)
        return None


def request_of(words, how, limits=None):
    """Return (arguments of `carry_out`, its files, pipes) for what `Popen._execute_child` is called with."""
    _, preexec_fn, _, pass_fds, cwd, environment, _, _, _, *pipes = how[:15]
    assert preexec_fn is None
    p2cread, _, _, c2pwrite, _, errwrite = pipes
    files = [own if own != -1 else number for number, own in enumerate((p2cread, c2pwrite, errwrite))]
    request = {
        "words": words,
        "folder": os.fspath(cwd or os.getcwd()),
        "environment": dict(os.environ if environment is None else environment),
        "start_new_session": bool(how[20]),
        "limits": limits or {},
        "places": [0, 1, 2, *pass_fds],
    }
    return request, [*files, *pass_fds], pipes


class Server:
    """Process that has imported what a run imports. It ends with this process or after `close`."""

    def __init__(self, environment):
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._forking = threading.Lock()
        self.started_with = read_at_start(environment)
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()})"],
                cwd=Path(__file__).parents[2],  # the test that needs it first may be beside a json.py of its own
                env=environment,
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )

    def serves(self, environment):
        """Whether a Python that starts in this environment is as one that is forked."""
        return read_at_start(environment) == self.started_with

    def fork(self, request, files):
        """Return the ID of a process that carries out a request.

        files : the pipe for its wait status, and what gets the numbers request["places"]
        """
        with self._forking:  # otherwise two threads may get each other's process, and wait for one that they do not end
            socket.send_fds(self._socket, [json.dumps(request).encode()], files)
            return STATUS.unpack(self._socket.recv(STATUS.size))[0]

    def close(self):
        self._socket.close()
        self._process.wait()


def read_at_start(environment):
    return {name: value for name, value in environment.items() if name.startswith(READ_AT_START)}


def serve(descriptor):
    """Fork a process for each request until the other end of the socket is closed. Returns in the forked ones."""
    signal.pthread_sigmask(signal.SIG_SETMASK, [])  # the test that needs it first may have blocked some
    for module in IMPORTED:
        import_module(module)
    gc.collect()
    gc.freeze()
    requests, running = socket.socket(fileno=descriptor), {}
    poll = select.poll()
    poll.register(requests, select.POLLIN)
    while True:
        for ready, _ in poll.poll():
            if ready != descriptor:
                pid, answers = running.pop(ready)
                poll.unregister(ready)
                status = os.waitpid(pid, 0)[1]
                os.write(answers, STATUS.pack(status))
                os.close(ready)
                os.close(answers)
                continue
            request, files, _, _ = socket.recv_fds(requests, MESSAGE_LIMIT, FILES_LIMIT)
            if not request:
                return None
            answers, *files = files
            pid = os.fork()
            if pid == 0:
                requests.detach()
                return end_quickly(lambda: carry_out(**json.loads(request), files=files))
            requests.send(STATUS.pack(pid))
            for file in files:
                os.close(file)
            ended = os.pidfd_open(pid)
            running[ended] = pid, answers
            poll.register(ended, select.POLLIN)


def end_quickly(program):
    """Run a program and end the process as Python does, but for the destruction of all modules, which takes 60 ms."""
    try:
        program()
        ended = SystemExit(0)
    except SystemExit as error:
        ended = error
    if not isinstance(ended.code, (int, type(None))):
        raise ended
    threading._shutdown()
    atexit._run_exitfuncs()
    try:
        for stream in filter(None, (sys.stdout, sys.stderr)):
            stream.flush()
    except (OSError, ValueError):
        raise ended from None
    os._exit((ended.code or 0) & 0xFF)


def carry_out(words, folder, environment, start_new_session, places, limits, files, controlled=True):
    """Do what Python does that was started with these words, and these files under the numbers `places`.

    controlled : whether the terminal of standard error controls a new session
    """
    if start_new_session:
        os.setsid()
    arrange(files, places)
    if start_new_session and controlled and os.isatty(2):
        fcntl.ioctl(2, termios.TIOCSCTTY, 0)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    renew_standard_streams()
    show_stack_on_signal()
    for limit, value in limits.items():
        resource.setrlimit(getattr(resource, limit), (value, value))
    if not limits:
        child_process.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": ForkedRecorder})
    (kind, name, *arguments) = words
    sys.orig_argv[:] = [sys.executable, *words]
    sys.argv[:] = [kind, *arguments]
    if kind == "-m":
        sys.path[0] = os.getcwd()
        runpy.run_module(name, run_name="__main__", alter_sys=True)
    else:
        sys.path[0] = ""
        exec(name, {"__name__": "__main__"})


def arrange(files, places):
    """Give open files the numbers `places`, and close all others."""
    above = max(*files, *places) + 1
    for file, place in zip([fcntl.fcntl(file, fcntl.F_DUPFD, above) for file in files], places):
        os.dup2(file, place)
    for file in {int(name) for name in os.listdir("/proc/self/fd")} - set(places):
        with suppress(OSError):  # that of the listing
            os.close(file)


replaced = []


def renew_standard_streams():
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        before = getattr(sys, name)
        buffering = 1 if name == "stderr" or os.isatty(number) else -1
        replaced.append(before)  # which would write what it holds
        stream = open(number, mode, buffering, before.encoding, before.errors, closefd=False)
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
