"""Notebooks, executed from top to bottom as somebody with a fresh clone does."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # imported where they are needed: nbformat takes two seconds, in each worker
    from nbclient import NotebookClient
    from nbformat import NotebookNode

HOME = Path(__file__).parents[3] / "notebooks"
NOTEBOOKS = sorted(HOME.glob("*.ipynb"))


# a second to import, for addresses, of which notebooks have none
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]


# the folder of the one before may be gone, and then `%reset` fails
ALONE = """import os
os.chdir("/")
%reset -f
import os
os.chdir({folder!r})
for name in [name for name in os.environ if name.startswith("JBCLOG_")]:
    del os.environ[name]
os.environ.update({environment!r})
del os, name
"""


ONCE = """import sys
sys.path.append({tests!r})
import jbclog.analysis.joints.joints
from support import once
once.install()
"""
"""The joints of a run, which several cells and notebooks want, are found once (`support.once`)."""


class Kernel:
    """A kernel for several notebooks in turn: each finds no name of the one before it."""

    def __init__(self, client: NotebookClient) -> None:
        self._client = client

    def execute(self, node: NotebookNode) -> None:
        self._client.nb = node
        self._client.execute(cleanup_kc=False)

    def executed(self, notebook: Path, folder: Path = HOME) -> NotebookNode:
        """The notebook after all of its cells ran in `folder`. Raises where one fails."""
        import nbformat

        node = nbformat.read(notebook, as_version=4)
        environment = {
            name: value for name, value in os.environ.items() if name.startswith("JBCLOG_")
        }
        alone = nbformat.v4.new_code_cell(ALONE.format(folder=str(folder), environment=environment))
        node.cells.insert(0, alone)
        self.execute(node)
        node.cells.remove(alone)
        return node


@contextmanager
def kernel() -> Iterator[Kernel]:
    import nbformat
    from nbclient import NotebookClient

    client = NotebookClient(nbformat.v4.new_notebook(), timeout=250)
    with client.setup_kernel():
        made = Kernel(client)
        first = nbformat.v4.new_code_cell(ONCE.format(tests=str(HOME.parent / "tests")))
        made.execute(nbformat.v4.new_notebook(cells=[first]))
        yield made


def run_here(notebook: Path) -> None:
    """Its cells in this process, which is quicker and takes warnings for errors; nothing that they
    show is kept.
    """
    import matplotlib as mpl
    from matplotlib import pyplot

    mpl.use("agg")
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    known: dict[str, object] = {"display": print}
    for cell in (one for one in cells if one["cell_type"] == "code"):
        code = "".join(line for line in cell["source"] if not line.startswith("%"))
        exec(compile(code, f"{notebook.name}: {cell['id']}", "exec"), known)
    for number in pyplot.get_fignums():
        pyplot.figure(number).canvas.draw()
    pyplot.close("all")


def shown(node: NotebookNode, cell: str) -> str:
    """What the cell of that id showed, as text."""
    return "\n".join(
        str(out.get("text", out.get("data", {}).get("text/plain", "")))
        for out in _outputs(node, cell)
    )


def has_picture(node: NotebookNode, cell: str) -> bool:
    return any("image/png" in out.get("data", {}) for out in _outputs(node, cell))


def _outputs(node: NotebookNode, cell: str) -> list[NotebookNode]:
    return next(one for one in node.cells if one.id == cell).outputs
