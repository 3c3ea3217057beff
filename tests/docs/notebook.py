"""The notebook of the tutorial: its execution, and the outputs that are stored in it.

`python -m tests.docs.notebook` executes it and stores new outputs.
"""

import tempfile

import nbformat
from nbclient import NotebookClient

from tests.docs.pages import DOCS
from tests.runtime.runs import environment

NOTEBOOK = DOCS / "tutorial" / "6_notebook.ipynb"


def stored():
    """Return the notebook of the tree."""
    return nbformat.read(NOTEBOOK, 4)


def executed(folder):
    """Return the notebook with new outputs, executed in a folder. Raises CellExecutionError."""
    notebook, where = stored(), {"metadata": {"path": str(folder)}}
    client = NotebookClient(notebook, timeout=120, coalesce_streams=True, record_timing=False, resources=where)
    client.execute(env=environment())
    for cell in notebook.cells:
        if "outputs" in cell:  # without the status line of a slow study, which is empty at its end
            cell.outputs = [output for output in cell.outputs if output.get("data") != {"text/plain": ""}]
    return notebook


def write():
    """Execute the notebook and store its outputs."""
    with tempfile.TemporaryDirectory() as folder:
        notebook = executed(folder)
    notebook.metadata.language_info = {"name": "python", "pygments_lexer": "ipython3"}
    nbformat.write(notebook, NOTEBOOK)


if __name__ == "__main__":
    write()
