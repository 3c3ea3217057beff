"""Source of the checks: this machine, or a folder with the files and command outputs of another.

Such a folder has the files at their paths (proc/version, sys/class/net/can0/type), and in `commands/` a file for each
command that a check may run, named by the command line with slashes as underscores: `commands/ip -details -json link`,
`commands/id`, `commands/ls -l _dev`.
"""

from __future__ import annotations

import fnmatch
import gzip
import os
import re
import subprocess
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

COMMAND_TIMEOUT = 5.0  # s
PI, JETSON, OTHER = "pi", "jetson", "other"


@dataclass(frozen=True)
class Device:
    """File in /dev. usable : whether this user may read and write it"""

    name: str
    group: str
    usable: bool


class Machine:
    """Files and command outputs of a machine.

    root : "/" for this machine, or a folder with those of another

    here : whether it is this machine
    """

    def __init__(self, root: str | Path = "/") -> None:
        self.root = Path(root)
        self.here = self.root.resolve() == Path("/")

    def path(self, name: str) -> Path:
        """Return the path of a file. name : its absolute path on the machine"""
        return self.root / name.lstrip("/")

    def raw(self, name: str) -> bytes:
        """Return the bytes of a file, b"" for an unreadable one."""
        try:
            return self.path(name).read_bytes()
        except OSError:
            return b""

    def read(self, name: str) -> str:
        """Return the stripped text of a file, "" for an unreadable one."""
        return self.raw(name).decode("utf-8", "replace").strip("\0 \n\t")

    def exists(self, name: str) -> bool:
        """Return whether there is a file, folder or link of this name."""
        return os.path.lexists(self.path(name))

    def glob(self, pattern: str) -> list[str]:
        """Return the names of matching files, with a leading slash, in numeric order."""
        names = [f"/{path.relative_to(self.root)}" for path in self.root.glob(pattern.lstrip("/"))]
        return sorted(
            names, key=lambda name: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]
        )

    def target(self, name: str) -> str:
        """Return the last part of a link's target, or ""."""
        try:
            return os.path.basename(os.readlink(self.path(name)))
        except OSError:
            return ""

    def output(self, *words: str) -> str:
        """Return the output of a command; "" if it is missing, fails, or exceeds COMMAND_TIMEOUT."""
        if not self.here:
            return self.read("commands/" + " ".join(words).replace("/", "_"))
        environment = {**os.environ, "LC_ALL": "C", "PATH": f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"}
        try:
            done = subprocess.run(
                words,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=COMMAND_TIMEOUT,
                env=environment,
            )
        except (OSError, subprocess.TimeoutExpired):
            return ""
        return done.stdout.strip() if done.returncode == 0 else ""

    def devices(self, *patterns: str) -> list[Device]:
        """Return the devices in /dev with matching names."""
        names = [
            (name, device)
            for name, device in self._devices.items()
            if any(fnmatch.fnmatch(name, pattern) for pattern in patterns)
        ]
        return [device for _, device in names]

    @cached_property
    def _devices(self) -> dict[str, Device]:
        """Devices by name, from the output of `ls -l /dev`.

        On this machine, access is tested, since it may exceed the mode.
        """
        devices: dict[str, Device] = {}
        for line in self.output("ls", "-l", "/dev").splitlines():
            match = re.match(r"c([rwxsStT-]{9})\S* +\d+ +(\S+) +(\S+) +\d+, +\d+ .* (\S+)$", line)
            if match:
                mode, owner, group, name = match.groups()
                usable = os.access(f"/dev/{name}", os.R_OK | os.W_OK) if self.here else self.permits(mode, owner, group)
                devices[name] = Device(name, group, usable)
        return dict(sorted(devices.items()))

    def permits(self, mode: str, owner: str, group: str) -> bool:
        """Return whether the user may read and write a file, by its mode as `ls -l` prints it: "rw-rw----"."""
        mine = [mode[6:8]] + [mode[3:5]] * (group in self.groups) + [mode[0:2]] * (owner == self.user)
        return self.root_user or "rw" in mine

    @cached_property
    def _id(self) -> str:
        return self.output("id")

    @property
    def user(self) -> str:
        """Name of the calling user."""
        match = re.match(r"uid=(\d+)(?:\(([^)]*)\))?", self._id)
        return (match[2] or match[1]) if match else "?"

    @property
    def root_user(self) -> bool:
        """Whether the calling user is root."""
        return self._id.startswith("uid=0")

    @property
    def groups(self) -> list[str]:
        """Names of the groups of this session."""
        return re.findall(r"\d+\(([^)]*)\)", self._id.partition("groups=")[2])

    def members(self, group: str) -> list[str] | None:
        """Return the members of a group, which the next login has; None if there is no such group."""
        for line in self.read("/etc/group").splitlines():
            name, _, _, members = (line.split(":") + [""] * 3)[:4]
            if name == group:
                return [member for member in members.split(",") if member]
        return None

    @property
    def model(self) -> str:
        """Model name by its manufacturer, or ""."""
        maker, product = (self.read(f"/sys/class/dmi/id/{name}") for name in ("sys_vendor", "product_version"))
        product = product if re.search("[A-Za-z]{4}", product) else self.read("/sys/class/dmi/id/product_name")
        return self.read("/proc/device-tree/model") or " ".join(part for part in (maker, product) if part)

    @property
    def kind(self) -> str:
        """ "pi" for a Raspberry Pi, "jetson" for an NVIDIA Jetson, else "other"."""
        compatible = self.read("/proc/device-tree/compatible")
        if "raspberrypi" in compatible or "Raspberry Pi" in self.model:
            return PI
        return JETSON if "nvidia,tegra" in compatible or self.exists("/etc/nv_tegra_release") else OTHER

    @property
    def system(self) -> str:
        """Name and version of the operating system, such as "Ubuntu 22.04.5 LTS"; "Linux" if unknown."""
        match = re.search(r'^PRETTY_NAME="?([^"\n]*)', self.read("/etc/os-release"), re.MULTILINE)
        return match[1] if match else "Linux"

    @property
    def kernel(self) -> str:
        """Version of the kernel, such as "6.8.0-45-generic"; "" if unknown."""
        words = self.read("/proc/version").split()
        return words[2] if len(words) > 2 else ""

    def kernel_option(self, option: str) -> str:
        """Return 'y' or 'm' for an option of the kernel, "" if it is off or unknown."""
        try:
            text = gzip.decompress(self.raw("/proc/config.gz")).decode()
        except (OSError, EOFError):
            text = ""
        text = text or self.read(f"/boot/config-{self.kernel}")
        match = re.search(rf"^CONFIG_{option}=(\w+)$", text, re.MULTILINE)
        return match[1] if match else ""

    def runs(self, program: str) -> bool:
        """Return whether a process of this name runs."""
        return any(self.read(name) == program for name in self.glob("proc/[0-9]*/comm"))

    def limit(self, title: str) -> int | None:
        """Return a hard limit of this session by its name in /proc/self/limits; None for unlimited.

        Raises KeyError for an unknown name.
        """
        for line in self.read("/proc/self/limits").splitlines():
            if line.startswith(title):
                hard = line[len(title) :].split()[1]
                return None if hard == "unlimited" else int(hard)
        raise KeyError(title)

    def capable(self, capability: int) -> bool:
        """Return whether processes of this session have a capability. capability : number in linux/capability.h"""
        match = re.search(r"^CapEff:\s*([0-9a-f]+)", self.read("/proc/self/status"), re.MULTILINE)
        return bool(match and int(match[1], 16) >> capability & 1)
