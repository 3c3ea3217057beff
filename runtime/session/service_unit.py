"""A systemd unit that starts a robot with the computer.

The unit starts `run` with --arm-on: drives have zero torque until the operator holds a button, even after a restart.
"""

from __future__ import annotations

import getpass
import os
import sys
from collections.abc import Iterable, Sequence

UNIT = """\
[Unit]
Description=Tickwork: {name}
{devices}
[Service]
Type=exec
User={user}
WorkingDirectory={folder}
Environment=PYTHONUNBUFFERED=1
ExecStart={command}
# SIGTERM ends the run with its safe stop. The guardian must outlive the run: systemd signals the run only.
KillMode=process
OOMPolicy=continue
TimeoutStopSec=15
SuccessExitStatus=143
# After a fault, and while an interface is missing, the run starts again. It waits for the button each time.
Restart=on-failure
RestartSec=5
LimitRTPRIO=99
LimitMEMLOCK=infinity

[Install]
WantedBy=multi-user.target
"""


def unit(name: str, channels: Iterable[str], arguments: Sequence[str]) -> str:
    """Return the text of the unit, which starts in the present folder with the present interpreter.

    name : name of the diagram
    channels : CAN interfaces, after which the unit starts
    arguments : arguments of the command `run`
    """
    devices = " ".join(f"sys-subsystem-net-devices-{channel}.device" for channel in sorted(channels))
    return UNIT.format(
        name=name.replace("%", "%%"),
        devices=f"Wants={devices}\nAfter={devices}\n" if devices else "",
        user=getpass.getuser(),
        folder=os.getcwd().replace("%", "%%"),
        command=" ".join(map(quoted, [sys.executable, "-m", "runtime", "run", *arguments])),
    )


def quoted(word: str) -> str:
    """Return a word of a command line as systemd reads it."""
    word = word.replace("%", "%%").replace("$", "$$").replace("\\", "\\\\").replace('"', '\\"')
    return f'"{word}"' if not word or set(word) & set(" \t;'\"\\") else word
