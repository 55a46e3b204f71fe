"""Nothing here descends from what it is to judge: the frames of the manuals import nothing, their
tests only the readers.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from support import golden

HERE = Path(__file__).parent
FRAMES = Path(golden.__file__).parent
FILES = sorted([*HERE.glob("*.py"), *FRAMES.glob("*.py")])
PRODUCT = ("jbclog", "support.product")
# the readers, and what they give
READERS = {
    "CorruptFrame",
    "Frame",
    "FrameReader",
    "LONGEST_FRAME",
    "LONGEST_OMEGA_FRAME",
    "MOST_HELD",
    "MOST_HELD_OF_OMEGA",
    "OmegaReader",
    "SHORTEST_FRAME",
    "parse_frame",
}


def _faults(text: str, *, may_read: bool) -> Iterator[str]:
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.startswith(PRODUCT))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(PRODUCT):
            allowed = READERS if may_read and node.module == "support.product" else set()
            yield from (
                f"{node.module}.{alias.name}" for alias in node.names if alias.name not in allowed
            )
        elif (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Attribute)
            and node.func.attr == "encode"
            and not node.args
        ):
            yield "encode() without the name of an encoding may be a frame's"
        elif isinstance(node, ast.Name) and node.id in ("__import__", "importlib", "eval", "exec"):
            yield node.id


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_nothing_here_imports_the_encoder(path: Path) -> None:
    assert list(_faults(path.read_text(encoding="utf-8"), may_read=path.parent == HERE)) == []


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("from jbclog.protocol.frame import Frame", "jbclog.protocol.frame.Frame"),
        ("from support.product import encode_omega", "support.product.encode_omega"),
        ("from support.product import OFF", "support.product.OFF"),
        ("import jbclog.protocol.frame", "jbclog.protocol.frame"),
        ("Frame('R', 'SMN').encode()", "encode() without the name of an encoding may be a frame's"),
    ],
)
def test_a_forbidden_import_is_found(text: str, fault: str) -> None:
    assert list(_faults(text, may_read=True)) == [fault]


def test_the_frames_of_the_manuals_may_not_even_import_the_readers() -> None:
    assert list(_faults("from support.product import Frame", may_read=False)) == [
        "support.product.Frame"
    ]
