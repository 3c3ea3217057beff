"""Follow the tutorial as its reader does: save its files, run its commands and execute its notebook in one folder.

python -m tests.docs.tutorial writes the pictures of the tutorial and of the README, the numbers of the tutorial's
outputs in virtual time, and the outputs of the notebook.
"""

import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.checkout import ROOT
from tests.docs import notebook, readme
from tests.docs.fences import DATE, agree, fences, same_text
from tests.runtime.robot.emulation.test_emulate import read_until
from tests.runtime.runs import environment, started
from tests.runtime.terminals import Terminal

TUTORIAL = ROOT / "docs" / "tutorial"
IMAGES = TUTORIAL / "images"
CHANNEL = "239.74.163.2"  # multicast group of the page's rig file
PRESSES = 6  # of the up arrow


class Reader:
    """A reader of the tutorial, with a folder for the files.

    folder : empty
    channel : multicast group in place of that of the page
    pause : s before and after the keys in the run on the rig
    options : options of the run on the rig
    how : arguments of `started`
    """

    def __init__(self, folder, channel=CHANNEL, pause=7.0, options=(), **how):
        self.folder, self.channel, self.pause, self.options, self.how = folder, channel, pause, options, how
        self.shown, self.emulator = "", None

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        if self.emulator:
            self.emulator.terminate()
            self.emulator.communicate()

    def follow(self, page):
        """Follow a page. Yields (its lines, lines that were printed) for each command and each excerpt of output."""
        session = []
        for fence in fences(TUTORIAL / page):
            if fence.file:
                (self.folder / fence.file).write_text(fence.text.replace(CHANNEL, self.channel))
            elif fence.language == "pycon":
                session.append(fence.text)
            elif fence.language == "text":
                yield fence.text.splitlines(), self.shown.splitlines()
            elif fence.language == "console":
                for words, output in fence.commands():
                    if words[:3] == ["python", "-m", "runtime"]:
                        self.shown = self.command(*words[3:])
                        yield output, self.shown.replace(self.channel, CHANNEL).splitlines()
        if session:
            (self.folder / "session.txt").write_text("\n".join(session))
            words = [sys.executable, "-m", "doctest", "session.txt"]
            variables = self.how.get("env", environment())
            doctest = subprocess.run(words, cwd=self.folder, env=variables, capture_output=True, text=True, timeout=60)
            assert doctest.returncode == 0, doctest.stdout + doctest.stderr

    def command(self, *words):
        """Run one command of `python -m runtime`. Returns what it prints."""
        if words[0] == "emulate":
            self.emulator = started(*words, cwd=self.folder, **self.how)
            return "".join(read_until(self.emulator.stdout, "Ctrl-C ends it"))
        if "--rig" in words and words[0] != "check":
            return self.run_on_rig(*words, *self.options)
        process = started(*words, cwd=self.folder, **self.how)
        out, err = process.communicate(timeout=60)
        assert (process.returncode, err) == (0, ""), (words, err)
        return out

    def run_on_rig(self, *words):
        """Arm a run, raise the first live parameter, set a mark and stop. Returns what the terminal shows."""
        shown = []
        with Terminal() as terminal:
            terminal.run(*words, cwd=self.folder)
            terminal.wait_for(r"press Enter to arm[^\r]*[\r\n]+.*ready")
            for keys, pattern in (
                (b"\n", "running"),
                (b"\t", r"profile\.peak 6 N·m"),
                *[(b"\x1b[A", f"profile.peak {6.0 + 0.2 * press:g} N·m") for press in range(1, PRESSES + 1)],
                (b"m", "mark 1"),
                (b" ", "try next"),
            ):
                if keys in (b"\n", b"\t", b" "):  # a key before the table has been shown arms nothing
                    time.sleep(self.pause)
                shown.append(terminal.look())
                terminal.press(keys)
                terminal.wait_for(pattern)
            assert terminal.end() == 0
            shown.append(terminal.look())
        return plain("".join(shown))


def plain(shown):
    """Return what a terminal shows as lines of text."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", shown).replace("\r\n", "\n").replace("\r", "\n")


def pages():
    """Return the names of the pages, in order."""
    return sorted(path.name for path in TUTORIAL.glob("[0-9]*.md"))


def corrected(shown, printed):
    """Return lines of a page with the numbers that are printed, where they differ."""
    rest, lines = iter(printed), []
    for line in shown:
        found = next((text for text in rest if same_text(line, text)), line) if line != "..." else line
        date = DATE.search(line)
        lines.append(line if line.endswith("...") or agree(line, found) else DATE.sub(date[0] if date else "", found))
    return lines


def write():
    """Follow the tutorial, and keep its pictures and the numbers of its outputs in virtual time."""
    with tempfile.TemporaryDirectory() as folder:
        rc = Path(folder) / "matplotlibrc"
        rc.write_text("svg.fonttype: none\nsvg.hashsalt: tutorial\n")
        with Reader(Path(folder), cold=True, env=environment(MATPLOTLIBRC=str(rc))) as reader:
            for page in pages():
                text = (TUTORIAL / page).read_text()
                for shown, printed in reader.follow(page):
                    if reader.emulator is None:
                        text = text.replace("\n".join(shown), "\n".join(corrected(shown, printed)))
                (TUTORIAL / page).write_text(text)
        (Path(folder) / readme.NAME).write_text(
            readme.draw(reader.folder / "assist", (reader.folder / "exo.svg").read_text())
        )
        IMAGES.mkdir(exist_ok=True)
        pages_text = "".join(path.read_text() for path in (ROOT / "README.md", *TUTORIAL.glob("*.md")))
        for picture in Path(folder).glob("*.svg"):
            if f"images/{picture.name})" in pages_text:
                rounded = re.sub(
                    r' d="[^"]*"', lambda path: re.sub(r"(\d\.\d)\d+", r"\1", path[0]), picture.read_text()
                )
                (IMAGES / picture.name).write_text(rounded)


if __name__ == "__main__":
    write()
    notebook.write()
