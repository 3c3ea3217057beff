"""`python -m runtime doctor`: whether a machine is fit to run a robot, and what to change.

    finding     what a check says: ok, worse, bad or unknown, with why it matters and what to change
    machine     where checks look: this machine, or a folder with the files and outputs of another
    kernel, power, user, can, ports, python
                the checks, one family a file
    script      a shell script that sets right what a script can, to be read and run by a person
    command     the command line

A check is a function of (machine, wants) that returns a Finding, several in a list, or None where it does not apply.
"""

from runtime.doctor import kernel, power, python, user
from runtime.machine import can, ports
from runtime.machine.finding import UNKNOWN, Finding

CHECKS = (*kernel.CHECKS, *power.CHECKS, *user.CHECKS, *can.CHECKS, *ports.CHECKS, *python.CHECKS)


def examine(machine, wants):
    """Findings of all checks. A check that fails on a strange machine cannot tell, and says so."""
    findings = []
    for check in CHECKS:
        try:
            found = check(machine, wants)
        except Exception as error:
            found = Finding(
                check.__name__.replace("_", " "), UNKNOWN, f"cannot be told: {type(error).__name__}: {error}"
            )
        findings += found if isinstance(found, list) else [found] if found else []
    return findings
