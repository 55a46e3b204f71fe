"""The tests of the contract reach the package through `support/product.py` alone, and it offers
nothing that no test takes. `tests/contract.toml` lists them, and `.ci/contract` freezes them.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from support import product
from support.readers.contract import Contract

CONTRACT = Contract.read()
TESTS = CONTRACT.tests
PUBLIC = ("jbclog", "jbclog.cli", "jbclog.live", "jbclog.spc")
"""What programs for other processes may import: what people import, and the command."""
FILES = [path for section in ("A", "B", "adapters") for path in CONTRACT.files(section)]


def reached(text: str) -> Iterator[str]:
    """Yield what of the package a module imports, or replaces by its place, and what of its inner
    parts the programs import that it has for other processes.
    """
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            places = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            places = [node.module or ""]
        elif isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            places = [str(node.args[0].value)] if "setattr" in ast.unparse(node.func) else []
        elif isinstance(node, ast.Constant) and re.search("[\n;]", str(node.value)):
            imported = re.findall(r"\b(?:from|import) (jbclog[\w.]*)", str(node.value))
            places = [place for place in imported if place not in PUBLIC]
        else:
            continue
        yield from (place for place in places if place.split(".")[0] == "jbclog")


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(TESTS).as_posix())
def test_a_test_of_the_contract_reaches_the_package_through_one_file(path: Path) -> None:
    assert list(reached(path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("import jbclog", "jbclog"),
        ("def f():\n    from jbclog.core.rows import COLUMN", "jbclog.core.rows"),
        ('monkeypatch.setattr("jbclog.guard.takeover.show", 1)', "jbclog.guard.takeover.show"),
        ('CODE = "import sys; from jbclog.record import seal"', "jbclog.record"),
    ],
)
def test_what_reaches_it_in_another_way_is_found(text: str, place: str) -> None:
    assert list(reached(text)) == [place]


def test_a_program_may_import_what_people_import() -> None:
    assert list(reached('CODE = "import sys; from jbclog.live import follow"')) == []


def test_nothing_is_offered_that_no_test_takes() -> None:
    paths = [path for path in TESTS.rglob("*.py") if path != Path(product.__file__)]
    texts = [path.read_text(encoding="utf-8") for path in paths]
    taken = "\n".join(text for text in texts if "support.product" in text or "product." in text)
    tree = ast.parse(Path(product.__file__).read_text(encoding="utf-8"))
    defined = [node.name for node in tree.body if isinstance(node, ast.FunctionDef | ast.ClassDef)]
    own = {"Contradiction", "__getattr__"}
    defined = [name for name in defined if name not in own and not re.match("_[a-z]", name)]
    offered = [*product.PLACES, *product.PATCHED, *defined]
    assert [name for name in offered if not re.search(rf"\b{re.escape(name)}\b", taken)] == []


# -- what is frozen --------------------------------------------------------------------------------

LISTED = """
[A]
line = ["test_a"]
[B]
line = ["*"]
[outside]
docs = ["test_free"]
[adapters]
support = ["helper"]
"""
MADE = ("line/test_a", "line/test_b", "docs/test_free", "support/helper", "unit/test_other")


@pytest.fixture
def contract(tmp_path: Path) -> Contract:
    tests = tmp_path / "tests"
    for name in MADE:
        path = tests / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("assert True\n")
    (tests / "contract.toml").write_text(LISTED)
    made = Contract.read(tests)
    made.path.write_text(made.text())
    return made


def test_what_is_as_it_was_frozen(contract: Contract) -> None:
    assert list(contract.differences()) == []
    assert contract.files("A") == [contract.tests / "line/test_a.py"]
    assert contract.files("B") == [contract.tests / "line/test_b.py"]


@pytest.mark.parametrize(
    ("name", "difference"),
    [
        ("line/test_a", "A tests/line/test_a.py: changed"),
        ("line/test_b", "B tests/line/test_b.py: changed"),
        ("line/test_c", "B tests/line/test_c.py: new"),
        ("docs/test_c", "tests/docs/test_c.py: new, in no list of tests/contract.toml"),
    ],
)
def test_what_is_changed_or_new_is_named(contract: Contract, name: str, difference: str) -> None:
    (contract.tests / f"{name}.py").write_text("assert 1 == 1\n")
    assert list(contract.differences()) == [difference]


@pytest.mark.parametrize("name", ["docs/test_free", "support/helper", "unit/test_other"])
def test_what_is_no_contract_may_change(contract: Contract, name: str) -> None:
    (contract.tests / f"{name}.py").write_text("assert 1 == 1\n")
    assert list(contract.differences()) == []


@pytest.mark.parametrize(
    ("name", "difference"),
    [
        ("line/test_a", "A tests/line/test_a.py: missing"),
        ("line/test_b", "B tests/line/test_b.py: missing"),
    ],
)
def test_what_is_missing_is_named(contract: Contract, name: str, difference: str) -> None:
    (contract.tests / f"{name}.py").unlink()
    assert list(contract.differences()) == [difference]


def test_a_file_that_goes_to_another_section_is_named(contract: Contract) -> None:
    listed = LISTED.replace('["test_a"]', "[]")
    (contract.tests / "contract.toml").write_text(listed)
    found = list(Contract.read(contract.tests).differences())
    assert found == [
        "B tests/line/test_a.py: new",
        "A tests/line/test_a.py: not listed any more",
    ]
