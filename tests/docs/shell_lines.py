"""The shell lines of pages: in consoles, indented, and in the text."""

import re

from tests.checkout import ROOT
from tests.docs.pages import NAMES

TOOLS = (
    "sudo ip apt apt-get systemctl modprobe nmcli candump chmod chgrp usermod pip make git nvpmodel ssh sh less rm cd"
    " cythonize openssl jupyter raspi-config setcap sysctl"
).split()
START = rf"(?:[A-Z]\w*=\S+ )*(?:{'|'.join(TOOLS)}) \S"
LINES = (
    re.compile(rf"^(?:\$ )?({START}.*(?:\\\n.*)*)", re.MULTILINE),  # in a console
    re.compile(rf"^ {{4,}}({START}.*(?:\\\n.*)*)", re.MULTILINE),  # indented
    re.compile(rf"`({START}[^`]*)`"),
)
FENCED = re.compile(r"^ *```\w*\n(.*?)^ *```", re.DOTALL | re.MULTILINE)


def shell_lines():
    """Return [(page, line)] without comments, and lines that are divided in one piece."""
    found = []
    for page in NAMES:
        text = (ROOT / page).read_text() if not page.endswith("CHANGELOG.md") else ""
        fenced, rest = "".join(FENCED.findall(text)), FENCED.sub("", text)
        for pattern, where in zip(LINES, (fenced, rest, rest)):
            for line in pattern.findall(where):
                joined = re.sub(r"\s*\\?\n\s*", " ", line).split("#")[0].strip()
                found.append((page, joined.replace(r"\|", "|")))
    return found
