"""Pages of the site that are generated from the code: blocks, Python interface, error codes."""

import importlib
import inspect
import io
import json
import os
import re
from collections import Counter
from contextlib import redirect_stdout, suppress
from unittest import mock

from graph import diagnostics
from runtime.cli.main import GROUPS, main
from runtime.robot.loading.catalog import class_card
from runtime.robot.rig import errors
from tests.docs import block_pages
from tests.docs.block_pages import INDEX
from tests.docs.pages import DOCS, PAGES, anchors

QUICK_FAMILIES = ("actuators", "controllers", "filters", "states", "wearer")
MODULES = {  # module: contents
    "graph": "diagrams, blocks and devices",
    "graph.conformance": "the test that every block must pass",
    "runtime": "functions that run, check, study and optimise a diagram, and load a recording",
    "runtime.record.analysis.trial": "one recording: its signals, strides, plots and table",
    "runtime.record.analysis.trials": "several recordings as one table",
    "runtime.session.simulate": "a simulation that the caller advances step by step",
    "runtime.experiments.studies.result": "the result of a study",
    "runtime.experiments.optimisation.result": "the result of an optimisation in simulation",
}
SHOWN = {  # module: its names for users; all public names of the other modules
    "graph.conformance": ["check_block"],
    "runtime.session.simulate": ["SimulatedRun"],
    "runtime.experiments.studies.result": ["StudyResult"],
    "runtime.experiments.optimisation.result": ["OptimisationResult"],
}
INHERITED = ("Trial", "OptimisationResult")  # classes whose page lists the members of their base class
SPECIAL = ("__getitem__", "__setitem__")
CODES = {"reference/errors.md": diagnostics.CODES, "reference/rigs.md": errors.CODES}


def write(folder, quick):
    """Write the generated pages.

    folder : Path of docs/api
    quick : whether to leave out most blocks, and the responses of all
    """
    pages = {f"python/{name}": page for name, page in python_pages().items()}
    pages |= {"error_codes": error_page(), "commands": command_page()}
    blocks = block_pages.pages(folder / "blocks", not quick, QUICK_FAMILIES if quick else None)
    pages |= {f"blocks/{name}": page for name, page in blocks.items()}
    for old in {*folder.rglob("*.md")} - {folder / f"{name}.md" for name in pages}:
        old.unlink()
    for name, page in pages.items():
        put(folder / f"{name}.md", page)
    put(folder / "scorer.js", scorer())


def put(path, text):
    """Write a text file unless it has this content, so that Sphinx does not read it again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def scorer():
    """Return the order of results of the site's search: Scorer of Sphinx."""
    texts = "\n".join(page.read_text() for page in PAGES if page != INDEX)
    named = Counter(re.findall(r"\b[A-Z]\w+", texts))
    blocks = {}
    for kind in block_pages.homes():
        card, name = class_card(kind), kind.__name__
        parameters = [words(f"{each['name']} {each['description']}") for each in card["parameters"]]
        blocks[name] = [round(named[name] / max(named.values()), 4), words(f"{name} {card['summary']}"), *parameters]
    text = (DOCS / "_templates" / "scorer.js").read_text()
    return re.sub(r"\{/\*.*?\*/\}", lambda _: json.dumps(blocks, ensure_ascii=False), text)


def words(text):
    """Return the words of a text in lower case, each once; those of LowPass, low_pass and low-pass are the same."""
    parts = re.findall(r"[a-z\d]+", re.sub(r"([a-z])([A-Z])", r"\1 \2", text).lower())
    return [*dict.fromkeys([*parts, *re.findall(r"\w+", text.lower())])]


def python_pages():
    """Return {name: page} of the Python interface: public functions and classes, from their docstrings."""
    rows = [f"| [{name}]({name}.md) | {title} |" for name, title in MODULES.items()]
    pages = {"index": "\n".join(["# Python interface\n", "| module | contents |", "|---|---|", *rows, ""])}
    for name, title in MODULES.items():
        module = importlib.import_module(name)
        parts = [f"# {name}\n\n{title[0].upper()}{title[1:]}.\n\n```{{eval-rst}}\n.. currentmodule:: {name}\n"]
        for key in SHOWN.get(name) or public(module):
            if inspect.isclass(value := getattr(module, key)):
                parts.append("\n   ".join([f".. autoclass:: {key}", *options(value)]) + "\n")
            else:
                parts.append(f".. autofunction:: {key}\n")
        pages[name] = "\n".join([*parts, "```\n"])
    return pages


def options(kind):
    """Return the options of autodoc for a class."""
    special = [name for name in SPECIAL if hasattr(kind, name)]
    return [
        ":members:",
        *([":inherited-members:"] if kind.__name__ in INHERITED else []),
        *([f":special-members: {', '.join(special)}"] if special else []),
    ]


def public(module):
    """Return the names of the public functions and classes of a module."""
    return getattr(module, "__all__", None) or [
        key
        for key, value in vars(module).items()
        if (inspect.isfunction(value) or inspect.isclass(value))
        and value.__module__ == module.__name__
        and not key.startswith("_")
        and key != "overload"
    ]


def command_page():
    """Return the page of the command line: what --help prints for each command."""
    head = "The output of `python -m runtime --help`, and of each command with `--help`."
    parts = ["# Command line", "", head, "", "```text", _help(), "```"]
    for names in GROUPS.values():
        for name in names:
            parts += ["", f"## {name}", "", "```text", _help(name), "```"]
    return "\n".join([*parts, ""])


def _help(*words):
    printed = io.StringIO()
    environment = mock.patch.dict(os.environ, COLUMNS="100")
    with redirect_stdout(printed), environment, mock.patch("sys.argv", ["-m"]), suppress(SystemExit):
        main([*words, "--help"])
    return printed.getvalue().rstrip()


def error_page():
    """Return the page of error codes: each code with its title and the page that explains it."""
    rows = []
    for page, codes in CODES.items():
        found = anchors(DOCS / page)
        own = {code.upper(): f"#{anchor}" for anchor in found for code in re.findall(r"tw\d{3}", anchor)}
        rest = "#troubleshooting" if "troubleshooting" in found else ""
        name = page.partition("/")[2].removesuffix(".md")
        rows += [f"| `{code}` | {title} | [{name}](../{page}{own.get(code, rest)}) |" for code, title in codes.items()]
    return "\n".join(
        [
            "# Error codes\n",
            "An error message contains its code, the place in your file, the problem and a remedy. Codes from TW101 "
            "on are those of rig files and devices.\n",
            "| code | error | explained in |",
            "|---|---|---|",
            *rows,
            "",
        ]
    )
