"""Build the site into build/site/VERSION, beside the versions built before: `python -m tests.docs.site`."""

import json
import re
import sys

from tests.docs.pages import ROOT

SITE = ROOT / "build" / "site"
NOT_FOUND = ROOT / "docs" / "_templates" / "not_found.html"
START = '<!doctype html><meta charset="utf-8"><meta http-equiv="refresh" content="0; url={}/index.html">\n'


def version():
    """Return the version of the tree."""
    return re.search(r'^version = "(.*)"', (ROOT / "pyproject.toml").read_text(), re.MULTILINE)[1]


def build():
    """Build the version of the tree. Every warning of Sphinx is an error. Returns the exit status."""
    from sphinx.cmd.build import main

    options = ["-W", "--keep-going", "-q", "-b", "html", "-d", str(ROOT / "build" / "doctrees")]
    return main([*options, str(ROOT / "docs"), str(SITE / version())])


def list_versions(site):
    """Write the versions, newest first, for their switcher, a start page that opens the newest, and a page for 404."""
    versions = [path.parent.name for path in site.glob("*/index.html")]
    versions.sort(key=lambda name: [int(part) if part.isdigit() else -1 for part in name.split(".")], reverse=True)
    (site / "versions.js").write_text(f"window.TICKWORK_VERSIONS = {json.dumps(versions)};\n")
    (site / "index.html").write_text(START.format(versions[0]))
    (site / "404.html").write_text(NOT_FOUND.read_text().replace("VERSION", versions[0]))


if __name__ == "__main__":
    status = build()
    if status == 0:
        list_versions(SITE)
        print(f"site: {SITE / 'index.html'}")
    sys.exit(status)
