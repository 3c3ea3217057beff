"""Real-time privileges of a loop for the duration of a run.

    realtime = Realtime("try")
    realtime.obtain()           # RealtimeRefused if "require" does not get everything
    ...                         # the loop, on this thread
    realtime.release()          # restores the previous settings

The timer slack and the slice are set in every mode, as they need no privilege; the garbage collector is the executor's.

A real-time thread that never sleeps could lock up the machine. After SPIN seconds without a sleep, the thread becomes
an ordinary one and continues; `spun` reports this.
"""

from __future__ import annotations

import os
import resource
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cext.clock import realtime as native
from runtime.host.console.terminal import program
from runtime.host.descriptors import close, identity
from runtime.host.machine.memory import prefault
from runtime.host.machine.processor import Processor, fastest_first
from runtime.host.system import (
    CAP_IPC_LOCK,
    CAP_SYS_NICE,
    address_space,
    capable,
    exhausted_group,
    isolated_processors,
    stack_limit,
    user,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator
    from posix import sched_param

MODES = ("off", "try", "require")
PRIORITY = 80  # below the kernel's own threads that must run (99), above its interrupt threads (50)
PRIORITY_LIMIT = 98
WAY = 2  # by which a loop is below those that have taken every processor; its guardian is not
SPIN = 0.5  # s
SLICE = 100_000  # ns, the minimum of Linux, which exceeds the computing time of a tick
STACK = 512 << 10  # bytes of stack touched in advance
HEADROOM = 64 << 20  # bytes of growth for a process with a limit on locked memory
GROUP = "realtime"  # group with the privileges of a loop, which `doctor --script` creates
LIMITS_FILE = "/etc/security/limits.d/90-tickwork.conf"
IDLE_DEVICE = "/dev/cpu_dma_latency"
RISK = (
    "caution: the loop has no real-time priority. Other processes can delay it: ticks are then lost, commands arrive "
    "late, and the run may stop the motors in mid-movement as if a drive were silent"
)


class RealtimeRefused(Exception):
    """Refusal of privileges under `require`. The text has a line for each of them and for each remedy."""


@dataclass(eq=False)
class Refusal(Exception):
    """Refused privilege. name : name of the privilege; why : reason, in one line; cure : remedy, in one line"""

    name: str
    why: str
    cure: str


class Realtime:
    """Real-time privileges of the calling thread and its process.

    mode : "off", "try" or "require"
    priority : priority under SCHED_FIFO, 1 to 98
    cpu : number of the processor to stay on; None for the last isolated one or, if none is isolated and the priority
        was granted, the last of the fastest

    granted, refused : list of names; list of Refusal
    processor : number of the processor that the loop is bound to, None if it may move
    others : processors for the other processes of the run, so that one is always free for the loop; empty with only one
    spun : whether the thread lost its priority because it did not sleep; valid after `release`
    """

    def __init__(self, mode: str = "off", priority: int = PRIORITY, cpu: int | None = None) -> None:
        if mode not in MODES or not 1 <= priority <= PRIORITY_LIMIT:
            raise ValueError(
                f"expected a mode of {', '.join(MODES)} and a priority of 1 to {PRIORITY_LIMIT}, got {mode!r} and "
                f"{priority!r}"
            )
        self.mode, self.priority, self.cpu = mode, priority, cpu
        self.granted: list[str] = []
        self.refused: list[Refusal] = []
        self.processor: int | None = None
        self.others: set[int] = set()
        self.spun = False
        self._undo = ExitStack()

    def __enter__(self) -> Realtime:
        self.obtain()
        return self

    def __exit__(self, *exception: object) -> None:
        self.release()

    def obtain(self) -> None:
        """Request all privileges for the calling thread and its process.

        Raises RealtimeRefused under "require", with nothing kept.
        """
        slack = native.timer_slack()
        native.set_timer_slack(1)
        self._undo.callback(native.set_timer_slack, slack)
        self._wake_soon()
        self._permitted = fastest_first(os.sched_getaffinity(0))
        self.others = set(self._permitted[1:])
        if self.mode == "off":
            return
        self.granted.append("timer slack 1 ns")
        try:
            for step in (self._lock_memory, self._stay_awake, self._take_priority, self._stay_on_one_processor):
                try:
                    name = step()
                except Refusal as refusal:
                    self.refused.append(refusal)
                else:
                    self.granted += [name] if name else []
        except BaseException:
            self.release()
            raise
        if self.refused and self.mode == "require":
            self.release()
            raise RealtimeRefused(
                "\n".join([f"--realtime require: not granted: {self._names()}; nothing was armed", *self._remedies()])
            )

    def release(self) -> None:
        """Restore the previous settings. A second call does nothing."""
        self._undo.close()

    def lines(self) -> list[str]:
        """Return remarks for the operator before the run."""
        if self.mode == "off":
            return []
        if not self.refused:
            return [f"realtime: {', '.join(self.granted)}"]
        return [f"realtime: granted {', '.join(self.granted)}; NOT granted {self._names()}", *self._remedies()]

    def risk(self) -> list[str]:
        """Return lines on the risk of a run on a rig without real-time priority; none if it was granted."""
        return [] if any(name.startswith("SCHED_FIFO") for name in self.granted) else [RISK]

    def summary(self) -> str:
        """Return one line for the end of the run."""
        lost = f"; LOST its priority: {SPIN:g} s without a sleep" if self.spun else ""
        return ", ".join(self.granted) + (f"; NOT granted: {self._names()}" if self.refused else "") + lost

    def metadata(self) -> dict[str, Any]:
        """Return the metadata for the recording."""
        return {
            "mode": self.mode,
            "granted": list(self.granted),
            "refused": {refusal.name: refusal.why for refusal in self.refused},
        }

    def _names(self) -> str:
        return ", ".join(refusal.name for refusal in self.refused)

    def _remedies(self) -> Iterator[str]:
        for refusal in self.refused:
            yield f"  {refusal.name}: {refusal.why}"
            yield f"      {refusal.cure}"
        yield f"  print a script with these remedies: {program()} doctor --script"

    def _wake_soon(self) -> None:
        """Shorten the timer slack and slice, so that an ordinary thread runs as soon as its tick is due."""
        with suppress(OSError):  # a sandbox forbids the call
            native.set_slice(SLICE)
            self._undo.callback(native.set_slice, 0)

    def _lock_memory(self) -> str:
        size = address_space()
        needed, name = size + HEADROOM, "locked memory"
        if not capable(CAP_IPC_LOCK) and not self._raise_limit(resource.RLIMIT_MEMLOCK, needed):
            limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
            raise Refusal(
                name,
                f"the memlock limit of {user()} is {_size_text(limit)}, and {_size_text(needed)} are needed",
                _limit_remedy("memlock", "unlimited"),
            )
        try:
            native.lock_memory()
        except OSError as error:
            raise Refusal(name, error.strerror or str(error), _limit_remedy("memlock", "unlimited")) from None
        self._undo.callback(native.unlock_memory)
        native.prefault_stack(min(STACK, stack_limit() // 8))
        self.prefault()
        return "memory locked"

    def prefault(self) -> None:
        """Bring in the memory that the loop uses, if memory is locked: again once all its objects exist."""
        if self.mode != "off":
            prefault()

    def _stay_awake(self) -> str | None:
        """Open the idle device with a latency of 0, which prevents deep idle states while it stays open."""
        name = "awake processors"
        try:
            device = os.open(IDLE_DEVICE, os.O_WRONLY)
            self._undo.callback(close, device, identity(device))
            os.write(device, bytes(4))
        except FileNotFoundError:
            if not os.path.exists("/sys/devices/system/cpu/cpu0/cpuidle"):
                return None  # no idle states
            raise Refusal(
                name, f"{IDLE_DEVICE} does not exist", f"docker run --device {IDLE_DEVICE}; or a kernel with CONFIG_PM"
            ) from None
        except OSError as error:
            raise Refusal(name, f"{IDLE_DEVICE}: {error.strerror}", _idle_remedy()) from None
        return "processors awake"

    def _stay_on_one_processor(self) -> str | None:
        before, isolated = set(self._permitted), isolated_processors()
        choice = [self.cpu] if self.cpu is not None else fastest_first(isolated)
        # without real-time priority, moving to a free processor is faster
        if not choice and len(before) > 1 and os.sched_getscheduler(0) & os.SCHED_FIFO:
            choice = self._permitted
        if not choice:
            return None
        with ExitStack() as guard:
            processor = guard.enter_context(closing(Processor(choice)))
            if processor.shared and self.cpu is None:
                return self._give_way()
            cpu = processor.number
            try:
                os.sched_setaffinity(0, {cpu})
            except OSError:
                raise Refusal(
                    f"processor {cpu}",
                    f"this process may only run on {number_list(before)}",
                    "start it without `taskset`, or put the processor into the cpuset of its control group",
                ) from None
            guard.callback(os.sched_setaffinity, 0, before)
            self._undo.push(guard.pop_all())
        self.processor, self.others = cpu, before - {cpu}
        return f"processor {cpu}" + (" (isolated)" if cpu in isolated else "")

    def _give_way(self) -> str:
        """Take a lower priority, so that its loop runs after those that have taken every processor."""
        words = f"SCHED_FIFO {self.priority}"
        if words not in self.granted:
            return ""
        self.granted.remove(words)
        self.priority = max(1, self.priority - WAY)
        os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(self.priority))
        return f"SCHED_FIFO {self.priority} (below other loops, which have taken every processor)"

    def _take_priority(self) -> str:
        name = f"SCHED_FIFO {self.priority}"
        permitted = capable(CAP_SYS_NICE) or self._raise_limit(resource.RLIMIT_RTPRIO, self.priority)
        before = os.sched_getscheduler(0), os.sched_getparam(0)
        with ExitStack() as guard:
            limit_spinning(guard, self._stop_watching)
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(self.priority))
            except OSError as error:
                raise self._why_no_priority(name, permitted, error) from None
            guard.callback(restore_scheduler, *before)
            self._undo.push(guard.pop_all())
        return name

    def _stop_watching(self) -> None:
        self.spun = native.stop_watching()

    def _why_no_priority(self, name: str, permitted: bool, error: OSError) -> Refusal:
        if not permitted:
            limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
            return Refusal(
                name, f"the rtprio limit of {user()} is {limit}", _limit_remedy("rtprio", max(90, self.priority))
            )
        file = exhausted_group()
        if file:
            return Refusal(
                name,
                f"its control group has no real-time budget: {file} is 0",
                f"echo 800000 | sudo tee {file}, or without budgets: sudo sysctl -w kernel.sched_rt_runtime_us=-1",
            )
        return Refusal(
            name,
            f"{error.strerror}, although its limits permit it: a container, or a control group without budget",
            "docker run --cap-add sys_nice --ulimit rtprio=90; without a container: sudo sysctl -w "
            "kernel.sched_rt_runtime_us=-1",
        )

    def _raise_limit(self, which: int, needed: int) -> bool:
        """Raise a limit as far as possible without privilege, and return whether it is `needed` or more."""
        soft, hard = resource.getrlimit(which)
        if _is_at_least(soft, needed):
            return True
        if not _is_at_least(hard, needed):
            return False
        resource.setrlimit(which, (hard, hard))
        self._undo.callback(resource.setrlimit, which, (soft, hard))
        return True


def limit_spinning(guard: ExitStack, ended: Callable[[], object]) -> None:
    """Make the calling thread an ordinary one when it does not sleep for SPIN, until `guard` is closed.

    ended : called then. The hard limit, which would kill, is not changed.
    """
    before = resource.getrlimit(resource.RLIMIT_RTTIME)
    native.watch_for_spinning()
    guard.callback(ended)
    soft = int(SPIN * 1e6)
    if before[1] != resource.RLIM_INFINITY:
        soft = min(soft, before[1] // 2)
    resource.setrlimit(resource.RLIMIT_RTTIME, (soft, before[1]))
    guard.callback(resource.setrlimit, resource.RLIMIT_RTTIME, before)


def restore_scheduler(policy: int, parameters: sched_param) -> None:
    """Restore the scheduler. The reset-on-fork flag cannot be cleared without privilege, and then stays."""
    try:
        os.sched_setscheduler(0, policy, parameters)
    except PermissionError:
        os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)


def _limit_remedy(item: str, value: int | str) -> str:
    """Return the remedy for a limit of the account. item, value : item and value in limits.conf"""
    return f"put `{user()} - {item} {value}` into {LIMITS_FILE} and log in again"


def _idle_remedy() -> str:
    """Return the remedy for an idle device that this user may not open."""
    rule = f'KERNEL=="cpu_dma_latency", GROUP="{GROUP}", MODE="0660"'
    return f"sudo groupadd -f {GROUP} && sudo usermod -aG {GROUP} {user()}, and the udev rule {rule}"


def _is_at_least(limit: int, needed: int) -> bool:
    """Return whether a resource limit is unlimited or large enough."""
    return limit == resource.RLIM_INFINITY or limit >= needed


def number_list(numbers: Iterable[int]) -> str:
    """Return numbers in ascending order as text: '0, 1, 3'."""
    return ", ".join(map(str, sorted(numbers)))


def _size_text(size: int) -> str:
    """Return a size in bytes as text in MiB."""
    return "unlimited" if size == resource.RLIM_INFINITY else f"{size >> 20} MiB"
