"""Checks of the privileges of the user who runs the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.machine.finding import OK, UNKNOWN, WORSE, Finding
from runtime.host.machine.realtime import LIMITS_FILE, PRIORITY
from runtime.host.system import CAP_IPC_LOCK, CAP_SYS_NICE, exhausted_group

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

MEMORY_REQUIRED = 512 << 20  # bytes: a run with its libraries and its growth
AGAIN = "then log in again"


def _rtprio(machine: Machine, wants: Wants) -> Finding:
    if machine.capable(CAP_SYS_NICE):
        return Finding("rtprio", OK, f"{machine.user} may use any priority")
    limit = machine.limit("Max realtime priority")
    if limit is None or limit >= PRIORITY:
        return Finding("rtprio", OK, f"{machine.user} may use priorities up to {99 if limit is None else limit}")
    return Finding(
        "rtprio",
        WORSE,
        f"the limit of {machine.user} is {limit}",
        "without real-time priority, any busy program delays the loop by milliseconds",
        f"put `{machine.user} - rtprio 90` into {LIMITS_FILE}, {AGAIN}",
        "limits",
    )


def _memlock(machine: Machine, wants: Wants) -> Finding:
    if machine.capable(CAP_IPC_LOCK):
        return Finding("memlock", OK, f"{machine.user} may lock any amount of memory")
    limit = machine.limit("Max locked memory")
    if limit is None or limit >= MEMORY_REQUIRED:
        return Finding(
            "memlock",
            OK,
            f"{machine.user} may lock {'any amount' if limit is None else f'{limit >> 20} MiB'} of memory",
        )
    return Finding(
        "memlock",
        WORSE,
        f"the limit of {machine.user} is {limit >> 10} KiB",
        "memory that is not locked can be paged out within a tick",
        f"put `{machine.user} - memlock unlimited` into {LIMITS_FILE}, {AGAIN}",
        "limits",
    )


def _control_group(machine: Machine, wants: Wants) -> Finding | None:
    file = exhausted_group(machine.read)
    if file is None:
        return None
    return Finding(
        "control group",
        WORSE,
        f"{file} is 0",
        "the control group has no real-time budget, so the kernel denies real-time priority",
        "sudo sysctl -w kernel.sched_rt_runtime_us=-1",
        "share",
        "-1",
    )


def groups(machine: Machine, wants: Wants) -> Finding:
    """Check the groups in effect, and those that only the next login adds."""
    if machine.user == "?":
        return Finding("groups", UNKNOWN, "`id` reports no user")
    names = [line.split(":")[0] for line in machine.read("/etc/group").splitlines()]
    coming = [name for name in names if machine.user in (machine.members(name) or []) and name not in machine.groups]
    if coming:
        return Finding(
            "groups",
            WORSE,
            f"{machine.user} will be in {', '.join(coming)} from the next login on",
            "this session lacks the permissions of these groups",
            "log in again (a desktop session: restart)",
        )
    return Finding("groups", OK, f"{machine.user} is in {', '.join(machine.groups)}")


CHECKS = (_rtprio, _memlock, _control_group, groups)
