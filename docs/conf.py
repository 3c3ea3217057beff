"""Configuration of the site. `make docs` builds it into build/site/VERSION, without a network."""

import inspect
import os
import re
import shutil
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from docutils import nodes  # noqa: E402

from runtime.robot.loading.draw import draw_file  # noqa: E402
from tests.diagrams.robots import ROBOTS, path  # noqa: E402
from tests.docs import generated, site, tutorial  # noqa: E402
from tests.docs.fences import fences  # noqa: E402

QUICK = bool(os.environ.get("DOCS_QUICK"))  # without pictures and notebooks, for the tests

project = "Tickwork"
version = release = site.version()
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "sphinx_copybutton"]
INDEX = "reference/blocks.md"  # of readers on GitHub: a site has a page for each block instead
exclude_patterns = [INDEX]
templates_path = ["_templates"]

smartquotes = False  # quotation marks and -- belong to code, also outside of backticks
myst_heading_anchors = 4
myst_enable_extensions = ["html_image", "tasklist"]
myst_disable_syntax = ["myst_line_comment"]  # a line of prose may begin with %
os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])  # of cells with %%bash
nb_execution_mode = "off" if QUICK else "force"
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 300
copybutton_prompt_text = r"\$ |>>> "
copybutton_prompt_is_regexp = True
copybutton_only_copy_prompt_lines = False

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
python_use_unqualified_type_names = True
add_module_names = False
viewcode_line_numbers = True
toc_object_entries_show_parents = "hide"

html_theme = "pydata_sphinx_theme"
html_title = f"Tickwork {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["site.js"]
html_search_scorer = str(ROOT / "docs" / "api" / "scorer.js")
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "navbar_end": ["versions", "theme-switcher"],
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_version_warning_banner": False,
    "navigation_depth": 3,
    "collapse_navigation": True,
    "back_to_top_button": True,
    "pygments_dark_style": "github-dark",
}
html_context = {"default_mode": "auto"}
pygments_style = "tango"


def code(text):
    """Return a paragraph of a docstring as reStructuredText: spans in backticks as literals, the rest verbatim."""
    parts = re.split(r"(`[^`\n]+`)", text)
    return "".join(
        f"`{part}`" if part.startswith("`") and len(part) > 2 else re.sub(r"([\\*|_`])", r"\\\1", part)
        for part in parts
    )


def docstring(app, what, name, thing, options, lines):
    """Convert a docstring in place to reStructuredText.

    Blocks of indented lines and tables are literal; `name : description` is an entry of a definition list.
    """
    found = []
    text = re.sub(r"; (?=\w+(, \w+)* : )", "\n", "\n".join(lines).strip("\n"))
    text = re.sub(r"(?<=\.) (?=\w+(, \w+)* : )", "\n\n", text)
    for block in re.split(r"\n\s*\n", text):
        rows = block.splitlines()
        if all(row.startswith(" ") for row in rows) or re.search(r"\S {3,}\S", block):
            found += ["::", "", *(f"    {row}" for row in rows)]
        elif re.match(r"[\w., *]+ : ", rows[0]):
            for row in rows:
                entry = re.match(r"([\w., *]+) : (.*)", row)
                found += [f"``{entry[1]}``", f"    {code(entry[2])}"] if entry else [f"    {code(row.strip())}"]
        else:
            found += map(code, map(str.strip, rows))
        found.append("")
    lines[:] = found


OUTSIDE = {  # section: its pages in other folders, before and after its own
    "reference": (["/api/blocks/index", "/api/python/index", "/api/commands"], ["/api/error_codes", "/CHANGELOG"]),
    "explanation": ([], ["decisions/index", "/safety_case", "/coming_from/index", "/CONTRIBUTING"]),
}


def skip(app, what, name, thing, skipped, options):
    """Leave out attributes that are modules: their text contains the path of a file."""
    return True if inspect.ismodule(thing) else None


def links(text):
    """Return the pages that a page links to, as paths relative to it."""
    return re.findall(r"\]\(([^)#\s:]+)\.(?:md|ipynb)[^)]*\)", text)


def contents(source, docname, text):
    """Return the pages below an index page: generated ones, those that it links to, then the rest of its folder."""
    folder = source / docname.rpartition("/")[0]
    if docname == "index":
        return [f"{title} <{page}>" for title, page in re.findall(r"\[\*\*(.*?)\*\*\]\((\S*?)\.md\)", text)]
    if folder == source / "api" / "blocks":
        return [page for page in links(text) if page.endswith("_blocks")]
    if folder.parent == source / "api":
        return links(text)
    pages = [page for page in links(text) if "/" not in page] + sorted(path.stem for path in folder.glob("*.md"))
    first, last = OUTSIDE.get(folder.name, ([], []))
    left_out = (docname.rpartition("/")[2], Path(INDEX).stem if folder.name == "reference" else "")
    return [page for page in dict.fromkeys(first + pages + last) if page not in left_out]


def read(app, docname, source):
    """Adapt links to what a site contains, and append its table of contents to an index page."""
    root = Path(app.srcdir)
    folder = (root / docname).parent

    def link(match):
        if ":" in match[2]:
            return match[0]
        if (folder / match[2]).resolve() == root / INDEX:
            return f"[{match[1]}](/api/blocks/index.md)"
        return match[1] if (folder / match[2]).is_dir() else match[0]

    source[0] = re.sub(r"\[([^\]]+)\]\(([^)#\s]+)\)", link, source[0])
    if docname.rpartition("/")[2] in ("index", "README"):
        entries = "\n".join(contents(root, docname, source[0]))
        source[0] += f"\n\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n"


def block_page(app, text):
    """Return the page of a block or of a family, as `Gain`, `Gain()` or `blocks.mathematics`; None for other code."""
    home, _, name = text.removesuffix("()").rpartition(".")
    if home == "blocks" and name.islower():
        name += "_blocks"
    elif not name[:1].isupper() or not (home == "" or home.startswith("blocks.")):
        return None
    page = f"api/blocks/{name}"
    return page if page in app.env.found_docs else None


def mark_words(app, doctree, docname):
    """Give code spans without a space the class `word`: a phone keeps `--option` in one line."""
    for span in doctree.findall(nodes.literal):
        if " " not in span.astext():
            span["classes"].append("word")


def link_blocks(app, doctree, docname):
    """Link the names of blocks in code spans to their pages, except in headings, links and a block's own page."""
    for span in list(doctree.findall(nodes.literal)):
        page = block_page(app, span.astext())
        parents = (nodes.reference, nodes.title, nodes.term)
        if page is None or page == docname or isinstance(span.parent, parents):
            continue
        target = app.builder.get_relative_uri(docname, page)
        span.replace_self(nodes.reference("", "", span.deepcopy(), internal=True, refuri=target))


def remove_template(app, exception):
    """Remove a template of the theme that is copied with its static files: its links lead nowhere."""
    (Path(app.outdir) / "_static" / "webpack-macros.html").unlink(missing_ok=True)


def draw_with_zoom(app, exception):
    """Write the pages with zoom that a click on the drawing of a diagram opens, beside the drawings."""
    images = Path(app.outdir) / "_images"
    if QUICK or exception:
        return
    for robot in ROBOTS:
        draw_file(path(robot), output=str(images / f"{robot}.html"))
    for page in (Path(app.srcdir) / "api" / "blocks" / "images").glob("*.html"):
        shutil.copy(page, images)
    with tempfile.TemporaryDirectory() as folder:
        for fence in [fence for page in tutorial.pages() for fence in fences(tutorial.TUTORIAL / page)]:
            if fence.file.endswith(".py"):
                Path(folder, fence.file).write_text(fence.text)
        draw_file(Path(folder, "exo.py"), output=str(images / "exo.html"))


def setup(app):
    """Write the generated pages, and connect the converters."""
    generated.write(Path(app.srcdir) / "api", quick=QUICK)
    app.connect("autodoc-process-docstring", docstring)
    app.connect("autodoc-skip-member", skip)
    app.connect("source-read", read)
    app.connect("doctree-resolved", mark_words)
    app.connect("doctree-resolved", link_blocks)
    app.connect("build-finished", remove_template)
    app.connect("build-finished", draw_with_zoom)
