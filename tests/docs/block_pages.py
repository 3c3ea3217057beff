"""Pages of the blocks of the library: one for each block, one for each family, and an index.

`python -m tests.docs.block_pages` writes the index of the tree, docs/reference/blocks.md.
"""

import re
import textwrap

import blocks
from graph.drawing import draw, svg
from graph.drawing import page as zoomed
from graph.drawing.cards import documentation, port_card, summary, unit_text
from runtime.robot.loading.catalog import class_card, family_of, import_line, libraries
from tests.docs import block_examples, responses
from tests.docs.pages import DOCS

INDEX = DOCS / "reference" / "blocks.md"
PORTS_DRAWN = 24  # of a block with more ports, or beside a Walker, only the connected ones are drawn
HEAD = """# Blocks

Every block of the library, by family. `python -m runtime blocks NAME` prints the ports and parameters of one.
"""


def homes():
    """Return {class of a block: module that exports it} of Tickwork's library."""
    return libraries()[0].homes


def family_groups():
    """Return {family: [class of a block]}."""
    groups = {}
    for kind, home in homes().items():
        groups.setdefault(family_of(home), []).append(kind)
    return groups


def markdown(text):
    """Return a paragraph of a docstring as Markdown: code in backticks is kept, paths of pages become links."""

    def convert(match):
        code, page, sign = match.groups()
        return code or (f"[docs/{page}](../../{page})" if page else f"\\{sign}")

    return re.sub(r"(`[^`\n]+`)|\bdocs/([\w/]+\.md)|([\\*_\[\]<#$|])", convert, text)


def cell(text):
    """Return the text of a table's cell."""
    return markdown(text).replace("\\|", "|").replace("|", "\\|")


def table(heads, rows):
    """Return a table, "" without rows."""
    if not rows:
        return ""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def index(link):
    """Return the page with all blocks.

    link : function that returns the address of a block from its class
    """
    parts = [HEAD]
    for family, kinds in family_groups().items():
        rows = [[f"[{kind.__name__}]({link(kind)})", _summary(kind)] for kind in kinds]
        parts.append(f"## {family}\n\n{table(['block', 'description'], rows)}")
    return "\n".join(parts)


def _summary(kind):
    return cell(re.sub(r"\.{4}$", "...", summary(kind)))


def source(kind):
    """Return the address of a block's source file from docs/reference."""
    return "../../" + kind.__module__.replace(".", "/") + ".py"


def pages(folder, pictures, families=None):
    """Return {name of a page: text} of blocks, with their index and families, and write their pictures.

    folder : Path of the pages
    pictures : whether responses are drawn
    families : those whose pages are made; None for all
    """
    images = folder / "images"
    images.mkdir(parents=True, exist_ok=True)
    groups = {family: kinds for family, kinds in family_groups().items() if families is None or family in families}
    found = {"index": _catalog(groups)}
    with block_examples.folder():
        for family, kinds in groups.items():
            found[f"{family}_blocks"] = _family(family, kinds)
            for kind in kinds:
                found[kind.__name__] = page(kind, homes()[kind], images, pictures)
    return found


def _catalog(groups):
    rows = [
        [f"[{family}]({family}_blocks.md)", ", ".join(f"[{kind.__name__}]({kind.__name__}.md)" for kind in kinds)]
        for family, kinds in groups.items()
    ]
    return f"# Blocks\n\n{blocks.__doc__}\n\n{table(['family', 'blocks'], rows)}"


def _family(family, kinds):
    rows = [[f"[{kind.__name__}]({kind.__name__}.md)", _summary(kind)] for kind in kinds]
    entries = "\n".join(kind.__name__ for kind in kinds)
    return f"# {family}\n\n{table(['block', 'description'], rows)}\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n"


def page(kind, home, images, pictures):
    """Return the page of a block, and write its pictures.

    home : module that exports it
    images : Path of the folder for pictures
    pictures : whether responses are drawn
    """
    card, shown, name = class_card(kind), block_examples.example_of(kind, home), kind.__name__
    block = block_examples.made(kind)
    card |= {side: [port_card(port) for port in getattr(block, side).values()] for side in ("inputs", "outputs")}
    card["made"] = [side for side in ("inputs", "outputs") if getattr(block, side).keys() != getattr(kind, side).keys()]
    first, *rest = documentation(kind)
    title, equation, more = _equation(first)
    parts = [f"# {name}", markdown(title)]
    if equation:
        parts.append(f"```{{code-block}} text\n:class: equation\n\n{equation}\n```")
    parts += [markdown(more)] if more else []
    parts.append(f"```python\n{import_line(kind, home)}\n```")
    parts += [_paragraph(text) for text in rest]
    all_ports = not shown.walker and len(card["inputs"]) + len(card["outputs"]) < PORTS_DRAWN
    drawing = draw(block_examples.diagram(shown), all_ports=all_ports)
    (images / f"{name}.svg").write_text(svg(drawing))
    (images / f"{name}.html").write_text(zoomed(drawing))
    parts.append(f"![block diagram with {name}](images/{name}.svg)")
    parts += [_ports(card, "inputs"), _ports(card, "outputs"), _parameters(card)]
    parts.append(f"## Example\n\n```python\n{shown.whole()}```")
    if pictures:
        parts += _responses(shown, images)
    parts.append(f"Runs: {card['runs']}. Source: [{kind.__module__}](../../../{kind.__module__.replace('.', '/')}.py).")
    return "\n\n".join(filter(None, parts)) + "\n"


def _ports(card, side):
    rows = [[f"`{port['name']}`", cell(unit_text(port)), cell(_port_text(port))] for port in card[side]]
    text = "They depend on the parameters; these are the ports of the example.\n\n" if side in card["made"] else ""
    if card["variadic"] and side == "inputs":
        return "## Inputs\n\nAny number of signals; without connections, all ports."
    return f"## {side.capitalize()}\n\n{text}{table(['name', 'unit', 'description'], rows)}" if rows else ""


def _parameters(card):
    rows = []
    for item in card["parameters"]:
        default, bounds = item["default"], item["bounds"]
        if re.search(r"\b0x", item["description"]):  # the address of a device
            default, bounds = _hexadecimal(default), _hexadecimal(bounds)
        words = "; ".join(word for word in (bounds, "live" if item["live"] else "") if word)
        rows.append([f"`{item['name']}`", cell(unit_text(item)), cell(item["description"]), cell(default), cell(words)])
    return "## Parameters\n\n" + table(["name", "unit", "description", "default", "bounds"], rows) if rows else ""


def _hexadecimal(text):
    """Return a text whose integers other than 0 are hexadecimal."""
    return re.sub(r"\b[1-9]\d*\b", lambda match: f"{int(match[0]):#x}", text)


def _responses(shown, images):
    name, parts = shown.kind.__name__, []
    what = responses.draw(shown, images / f"{name}_response.svg")
    if what:
        parts.append(f"{what}:\n\n![{what} of {name}](images/{name}_response.svg)")
    if responses.draw_frequency_response(shown, images / f"{name}_frequency.svg"):
        parts.append(f"Frequency response at 200 Hz:\n\n![Frequency response of {name}](images/{name}_frequency.svg)")
    return parts


def _equation(text):
    """Return (title, equation, rest) of the first paragraph of a docstring; equation is "" if it has none."""
    first, _, rest = re.sub(r"(?<=[.!?])\s+(?=[A-Z(`])", "\n", text, count=1).partition("\n")
    title, colon, equation = first.partition(": ")
    if colon and "=" in equation:
        return f"{title}.", re.sub(r"(?<!\.)\.$|(?<=\.{3})\.$", "", equation).replace("`", ""), rest
    return first, "", rest


def _paragraph(text):
    if not re.search(r"^\s", text, re.MULTILINE):
        return markdown(text)
    return f"```text\n{textwrap.dedent(text)}\n```"


def _port_text(port):
    words = [port["description"], f"default {port['default']}" if "default" in port else "", port.get("range", "")]
    return "; ".join(word for word in words if word)


if __name__ == "__main__":
    INDEX.write_text(index(source))
