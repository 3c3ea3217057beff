"""What the command line says: results on standard output, complaints on standard error.

However that goes, the run keeps its exit code: a reader that has gone away (`| head -1`), a full disk, a terminal that
was closed.
"""

import os
import re
import shutil
import sys


def program():
    """How the person can start us again: with words that their shell understands, whether or not an environment is
    activated.
    """
    script = os.path.abspath(sys.argv[0])
    if os.path.basename(script) == "tickwork":
        return "tickwork" if on_path("tickwork", script) else relative(script)
    name = next((name for name in ("python", "python3") if on_path(name, sys.executable)), None)
    return f"{name or relative(sys.executable)} -m runtime"


def on_path(name, file):
    """Whether the shell finds `file` by this name. Folders are compared: files of environments are links to one and the
    same.
    """
    found = shutil.which(name)
    return found is not None and os.path.realpath(os.path.dirname(found)) == os.path.realpath(os.path.dirname(file))


# What stands for a character that the encoding of a terminal or file does not have.
IN_ASCII = str.maketrans(
    {
        "µ": "u",
        "·": "*",
        "−": "-",
        "°": " deg",
        "²": "^2",
        "³": "^3",
        "±": "+-",
        "×": "x",
        "τ": "tau",
        "σ": "sigma",
        "Δ": "delta",
        "θ": "theta",
        "ω": "omega",
        "…": "...",
        "–": "-",
        "→": "->",
        "≤": "<=",
        "≥": ">=",
        "━": "#",
        "╌": ".",
        "│": "|",
        "─": "-",
        "“": '"',
        "”": '"',
        "’": "'",
    }
)


# What a terminal would obey, or show in another order, besides the ends of lines and tabs; and, first, the styles of
# our own.
CONTROL = re.compile("(\x1b\\[(?:0|1|2|31|32|33)m)|[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


def harmless(text, coloured):
    """A text whose control characters are written out, as in \\x1b. Names, notes and events of a recording may hold
    any.

    coloured : whether our own styles may be in it
    """
    return CONTROL.sub(
        lambda found: found[0] if found[1] and coloured else found[0].encode("unicode_escape").decode(), text
    )


def tell(lines):
    """Lines for standard output."""
    write(lines, sys.stdout)


def complain(lines):
    """Lines for standard error, with paths below the working folder as a person there would write them."""
    write([relative(line) for line in lines], sys.stderr)


def write(lines, stream):
    if stream is None:
        return
    try:
        text = harmless("".join(f"{line}\n" for line in lines), stream.isatty())
        stream.write(readable(text, stream.encoding or "utf-8"))
        stream.flush()
    except BrokenPipeError:
        silence(stream)
    except OSError as error:
        silence(stream)
        if stream is not sys.stderr:
            complain([f"tickwork: cannot write to standard output: {error.strerror}"])


def readable(text, encoding):
    """A text without characters that an encoding lacks."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        text = text.translate({code: word for code, word in IN_ASCII.items() if not encodable(chr(code), encoding)})
    return text.encode(encoding, "replace").decode(encoding)


def encodable(character, encoding):
    try:
        character.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def silence(stream):
    """What is still in the stream's buffer goes nowhere, rather than into an error at the interpreter's end."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, stream.fileno())
    os.close(nowhere)


def relative(text):
    """A text with paths relative to the working folder, where they lie in it."""
    try:
        here = os.getcwd().rstrip("/") + "/"
    except OSError:  # it was removed
        return text
    return re.sub(rf"(?<![\w./~-]){re.escape(here)}(?=[^/\s])", "", text) if here != "/" else text
