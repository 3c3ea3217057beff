"""Check of a machine for running a robot: `python -m runtime doctor`.

    finding     result of a check: ok, worse, bad or unknown, with the reason and the remedy
    machine     source of the checks: this machine, or a folder with files and outputs of another
    kernel, power, user, can, ports, python
                the checks, by topic
    script      shell script with the automatic remedies
    access      parts of the script on request: access point, remote desktop
    command     command line

A check is a function of (machine, wants) that returns a Finding, a list of them, or None if it does not apply.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from runtime.host.machine import can, ports
from runtime.host.machine.finding import UNKNOWN, Finding
from runtime.setup.doctor import kernel, power, python, user

if TYPE_CHECKING:
    from runtime.host.machine.finding import Wants
    from runtime.host.machine.probe import Machine

CHECKS = (*kernel.CHECKS, *power.CHECKS, *user.CHECKS, *can.CHECKS, *ports.CHECKS, *python.CHECKS)


def examine(machine: Machine, wants: Wants) -> list[Finding]:
    """Return the findings of all checks. A check that raises on an unusual machine results in an unknown finding."""
    findings = []
    for check in CHECKS:
        try:
            result = check(machine, wants)
        except Exception as error:
            result = Finding(
                check.__name__.lstrip("_").replace("_", " "), UNKNOWN, f"check failed: {type(error).__name__}: {error}"
            )
        findings += result if isinstance(result, list) else [result] if result else []
    return findings
