"""Sleep of the computer. While it is suspended, no process runs, and drives keep their last command.

systemd-logind does not suspend a computer while an inhibitor is held: neither when it is idle, nor by a key or the lid
of a laptop, nor by `systemctl suspend`. Root can override it, and a write to /sys/power/state ignores it.
"""

from __future__ import annotations

import select
import subprocess
from contextlib import suppress

from runtime.host.machine.probe import Machine

STATES = "/sys/power/state"
TARGETS = ("sleep", "suspend", "hibernate", "hybrid-sleep")  # systemd's, one of which every sleep starts
MASK = "sudo systemctl mask sleep.target suspend.target hibernate.target hybrid-sleep.target"
WHAT = "sleep:idle:handle-lid-switch:handle-suspend-key:handle-hibernate-key"
GRANT_TIMEOUT = 1.0  # s


def can_sleep(machine: Machine) -> bool:
    """Return whether a machine can be suspended: its kernel has such a state, and systemd's targets are not masked."""
    return bool(machine.read(STATES)) and not all(
        machine.target(f"/etc/systemd/system/{name}.target") == "null" for name in TARGETS
    )


class SleepInhibitor:
    """Inhibitor of logind, which a process of systemd-inhibit holds until `release`, or until this process ends.

    reason : text that `systemd-inhibit --list` shows
    """

    def __init__(self, reason: str, machine: Machine | None = None) -> None:
        self._child: subprocess.Popen[bytes] | None = None
        self._problem: str | None = ""  # None: not known yet
        if not can_sleep(machine or Machine()):
            return
        try:
            # cat returns the line that it is sent as soon as the inhibitor is held
            self._child = subprocess.Popen(
                ["systemd-inhibit", f"--what={WHAT}", "--who=tickwork", f"--why={reason}", "--mode=block", "cat"],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                start_new_session=True,  # neither asks for a password on this terminal, nor receives its Ctrl-C
            )
        except OSError as error:
            self._problem = f"systemd-inhibit: {error.strerror}"
            return
        self._problem = None
        assert self._child.stdin is not None
        with suppress(BrokenPipeError):
            self._child.stdin.write(b"held\n")
            self._child.stdin.flush()

    def problem(self) -> str:
        """Return why the computer may be suspended during the run, "" if it may not. Waits for the grant."""
        if self._problem is None:
            self._problem = self._answer()
            if self._problem:
                self.release()
        return self._problem

    def _answer(self):
        """Return the reason for a refusal, "" for a grant."""
        assert self._child is not None and self._child.stdout is not None and self._child.stderr is not None
        ready, _, _ = select.select([self._child.stdout], [], [], GRANT_TIMEOUT)
        if not ready:
            return f"systemd-inhibit: no reply within {GRANT_TIMEOUT:g} s"
        if self._child.stdout.readline():
            return ""
        lines = self._child.stderr.read().decode("utf-8", "replace").split("\n")
        return f"systemd-inhibit: {lines[0].strip() or 'refused'}"

    def remarks(self) -> list[str]:
        """Return lines for the operator before the run."""
        problem = self.problem()
        if not problem:
            return []
        return [
            f"caution: this computer can be suspended during the run ({problem}). Drives without a time-out then keep "
            f"their last command until it resumes. Disable it: {MASK}"
        ]

    def release(self) -> None:
        """Allow sleep again."""
        child, self._child = self._child, None
        if child is None:
            return
        with suppress(OSError):  # a block has closed the descriptor
            child.kill()
        child.wait()
        for pipe in (child.stdin, child.stdout, child.stderr):
            assert pipe is not None
            with suppress(OSError):
                pipe.close()
