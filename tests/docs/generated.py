"""Pages of the site that are generated from the code: Python interface, error codes."""

import importlib
import inspect

from graph import diagnostics
from runtime.rig import errors

MODULES = {  # module: title
    "graph": "graph: diagrams and blocks",
    "graph.conformance": "graph.conformance: tests of blocks",
    "runtime": "runtime: runs and recordings",
    "runtime.analysis.trial": "runtime.analysis.trial: one recording",
    "runtime.analysis.trials": "runtime.analysis.trials: several recordings",
}
CODES = {"reference/errors.md": diagnostics.CODES, "reference/rigs.md": errors.CODES}


def write(folder):
    """Write the generated pages.

    folder : Path of docs/api
    """
    put(folder / "python.md", python_page())
    put(folder / "error_codes.md", error_page())


def put(path, text):
    """Write a text file unless it has this content, so that Sphinx does not read it again."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


def python_page():
    """Return the page of the Python interface: public functions and classes, from their docstrings."""
    parts = ["# Python interface\n\nBlocks are described by `python -m runtime blocks NAME`.\n"]
    for name, title in MODULES.items():
        module = importlib.import_module(name)
        public = getattr(module, "__all__", None) or [
            key
            for key, value in vars(module).items()
            if inspect.isroutine(value) | inspect.isclass(value)
            and value.__module__ == name
            and not key.startswith("_")
            and key != "overload"
        ]
        parts.append(f"## {title}\n\n```{{eval-rst}}\n.. currentmodule:: {name}\n")
        for key in public:
            kind = "class" if inspect.isclass(getattr(module, key)) else "function"
            members = "\n   :members:" if kind == "class" else ""
            parts.append(f".. auto{kind}:: {key}{members}\n")
        parts.append("```\n")
    return "\n".join(parts)


def error_page():
    """Return the page of error codes: each code with its title and the page that explains it."""
    rows = [
        f"| `{code}` | {title} | [{page.partition('/')[2].removesuffix('.md')}](../{page}) |"
        for page, codes in CODES.items()
        for code, title in codes.items()
    ]
    return "\n".join(
        [
            "# Error codes\n",
            "An error names its code, the place in your file, what is wrong, and what to do.\n",
            "| code | error | explained in |",
            "|---|---|---|",
            *rows,
            "",
        ]
    )
