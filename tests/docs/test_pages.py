"""The pages that are made from the code are what the code makes, and miss nothing of it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from jbclog.analysis.verdict.acceptance import LIMIT_NAMES
from jbclog.analysis.verdict.rule import Result
from jbclog.config.sim_spec import KEYS_OF_FAULT
from jbclog.core.outcome import Exit
from jbclog.core.rows import QUALITIES, SettingOutcome
from jbclog.report.audit.files import COLUMNS as COLUMNS_OF_AUDIT
from support.pages.all_pages import PAGES, REFERENCE
from support.pages.configuration import FILES, keys
from support.pages.configuration_words import FAULTS, MEANINGS
from support.pages.exit_codes import MEANINGS as CODES
from support.pages.main_path import files as files_of_main_path
from support.pages.manifest import MEANINGS as MANIFEST
from support.pages.manifest import keys as manifest_keys
from support.pages.other_files import CSV
from support.pages.other_files import MEANINGS as OTHERS
from support.pages.other_files import keys as other_keys
from support.pages.tables import MEANINGS as COLUMNS
from support.pages.tables import OUTCOME, QUALITY, meaning, tables
from support.pages.verdict import RESULTS, RULES
from support.readers.texts import ROOT

MAKE = "python tests/support pages"


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.name)
def test_a_page_is_what_the_code_makes(path: Path) -> None:
    assert path.read_text(encoding="utf-8") == PAGES[path](), (
        f"the code has changed: {MAKE} writes the pages anew"
    )
    assert MAKE in path.read_text(encoding="utf-8")


def test_the_main_path_is_read_in_the_order_of_its_picture() -> None:
    text = (ROOT / "docs" / "explanation" / "architecture.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\d\. \[[\w/]+\.py\]\(../../([\w/.]+)\)", text, re.MULTILINE)
    assert listed == [path.as_posix() for path in files_of_main_path()]
    assert all((ROOT / path).is_file() for path in listed)


@pytest.mark.parametrize("title", FILES)
def test_every_key_has_a_meaning(title: str) -> None:
    assert sorted(MEANINGS[title]) == sorted(
        f"{table.strip('[]')}.{key}" for table, key, _ in keys(title)
    )


def test_every_fault_and_every_exit_code_has_a_meaning() -> None:
    assert set(FAULTS) == set(KEYS_OF_FAULT)
    assert set(CODES) == set(Exit)


def test_every_column_has_a_meaning_and_nothing_else_has() -> None:
    described = {f"{name}.{field.name}" for name, schema in tables().items() for field in schema}
    assert set(COLUMNS) <= described
    assert all(meaning(name, field) for name, schema in tables().items() for field in schema)
    assert (list(QUALITY), set(OUTCOME)) == (list(QUALITIES), set(SettingOutcome))


def test_every_key_of_the_manifest_has_a_meaning() -> None:
    assert set(MANIFEST) == manifest_keys()


def test_every_key_of_ledger_verifications_annotations_and_csv_has_a_meaning() -> None:
    assert set(OTHERS) == other_keys()
    assert list(CSV) == list(COLUMNS_OF_AUDIT)


def test_every_rule_of_the_verdict_is_listed() -> None:
    texts = [
        path.read_text(encoding="utf-8")
        for path in (ROOT / "jbclog" / "analysis" / "verdict").glob("*.py")
    ]
    written = {name for text in texts for name in re.findall(r'(?:Rule|Asked)\(\s*"(\w+)"', text)}
    written |= {
        name
        for text in texts
        for name in re.findall(r'^RULE(?:: Final)? = "(\w+)"', text, re.MULTILINE)
    }
    assert written <= set(RULES)
    assert written >= {"record", "station", "settings", "reached", "verification"}
    assert {
        name for name in LIMIT_NAMES if not any(f"`{name}`" in limit for limit, _ in RULES.values())
    } == set()
    assert set(RESULTS) == set(Result)


def test_every_environment_variable_is_listed() -> None:
    """Those that jbclog and the notebooks read, and those of the tests."""
    texts = [
        path
        for folder in ("jbclog", "notebooks", "tests", ".ci")
        for path in (ROOT / folder).rglob("*")
    ]
    read = re.compile(r"""environ(?:\.get\(|\[)\\?["'](\w+)|["'](\w+)\\?["'] in os\.environ""")
    ours = {
        name
        for path in texts
        if path.suffix in (".py", ".ipynb")
        for found in read.findall(path.read_text(encoding="utf-8"))
        for name in found
        if name.startswith("JBCLOG_") or ("tests" not in path.parts and name)
    }
    page = (REFERENCE / "environment.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    assert ours - {"JBCLOG_MUTANT"} <= listed
    code = "".join(
        path.read_text(encoding="utf-8")
        for path in texts
        if path.is_file() and path.suffix in (".py", ".ipynb", "")
    )
    assert [name for name in listed if name not in code] == []
