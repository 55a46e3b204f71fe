"""The written pages of the reference: what they name exists, rows are numbered once, frames have
their check bytes.
"""

from __future__ import annotations

import re
from functools import reduce
from operator import xor
from pathlib import Path

import pytest

from jbclog.analysis.alarms.state_machine import Transition
from jbclog.analysis.event_kinds import KINDS
from jbclog.config.recipe import COMMAND_OF
from jbclog.protocol.commands.decisions import decisions
from jbclog.protocol.commands.family import FAMILIES
from support.readers.repository import TEXTS
from support.readers.texts import ROOT

REFERENCE = ROOT / "docs" / "reference"
PAGES = sorted(REFERENCE.glob("*.md"))
every_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def text_of(name: str) -> str:
    return (REFERENCE / name).read_text(encoding="utf-8")


@every_page
def test_links_and_paths_lead_somewhere(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\"\s]+)", text) if "://" not in link]
    assert [
        link
        for link in links
        if not (page.parent / link.partition("#")[0]).exists() and link[0] != "#"
    ] == []
    named = re.findall(r"`((?:tests|jbclog|docs|profiles)/[\w./-]+\.\w+)`", text)
    assert [name for name in named if not (ROOT / name).exists()] == []


# -- what code cites -------------------------------------------------------------------------------

CODE = [
    name
    for name in TEXTS
    if name.startswith(("jbclog/", "tests/"))
    and name.endswith(".py")
    and ROOT / name != Path(__file__)
]
CITED_PAGE = re.compile(r"\bdocs/[\w./-]+\.md(?:, ([A-Z][a-z]+(?: [a-z]+)*|jbclog \w+))?")
NOT_HERE = re.compile(
    r"\b(?:contract|house|quality|language)\.md|(?<![\w/-])(?:protocol|faults)\.md|\b[Dd]igest"
    r" [AB][-.]\d|\(contract(?:\)|, [\"`])"
    r"|\b[Ss]eeds? 00[0-4]"
)
"""Texts that a reader does not have, and the manuals by a name that they do not bear."""


def test_the_pages_that_code_cites_exist_with_their_sections() -> None:
    for name in CODE:
        text = " ".join((ROOT / name).read_text(encoding="utf-8").split())
        for cited in CITED_PAGE.finditer(text):
            page = ROOT / cited[0].partition(",")[0]
            assert page.exists(), f"{name} cites {cited[0]}"
            headings = tuple(
                re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
            )
            assert not cited[1] or cited[1].startswith(headings), f"{name} cites {cited[0]}"


def test_code_cites_nothing_that_a_reader_does_not_have() -> None:
    found = [
        f"{name}:{number}: {line.strip()}"
        for name in CODE
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        # a link of a page that is made
        if NOT_HERE.search(line) and NOT_HERE.search(re.sub(r"\]\([^)]*\)", "]", line))
    ]
    assert found == []


# -- faults ----------------------------------------------------------------------------------------

ROWS = re.findall(r"^\| ([FIS]-?\d+) \| (.+) \|$", text_of("faults.md"), re.MULTILINE)


def test_each_row_of_the_catalogue_stands_once() -> None:
    names = [name for name, _ in ROWS]
    assert sorted(names) == sorted(
        [
            *(f"F-{n}" for n in range(1, 56)),
            *(f"I{n}" for n in range(1, 10)),
            *(f"S-{n}" for n in range(1, 6)),
        ]
    )


def test_each_fault_and_each_rule_names_a_test() -> None:
    assert [name for name, cells in ROWS if name[0] != "I" and "`tests/" not in cells] == []


def test_each_citation_of_a_row_finds_it() -> None:
    known = {name for name, _ in ROWS} | {f"B-{number}" for number in decisions()}
    cited = re.compile(
        r"docs/reference/(?:faults|contradictions)\.md,((?:(?: and|,| to)?\s+(?:[FBS]-|I)\d+)+)"
    )
    for name in TEXTS:
        for rows in cited.findall((ROOT / name).read_text(encoding="utf-8")):
            assert set(re.findall(r"[FBSI]-?\d+", rows)) <= known, f"{name} cites{rows}"
    for name in CODE:  # by the number alone
        numbers = set(re.findall(r"\bB-\d+\b", (ROOT / name).read_text(encoding="utf-8")))
        assert numbers <= known, f"{name} cites {numbers - known}"


# -- protocol --------------------------------------------------------------------------------------


def _check_byte(text: str, addresses: str) -> int:
    return reduce(xor, f"\x02{addresses}{text}\x03".encode())


def test_the_check_bytes_are_right() -> None:
    rows = re.findall(r"`([RWA][^`]*)` \| ([0-9A-F]{2}) \| ([0-9A-F]{2}) ", text_of("protocol.md"))
    assert len(rows) == 22
    for text, bare, addressed in rows:
        assert (_check_byte(text, ""), _check_byte(text, "0001")) == (
            int(bare, 16),
            int(addressed, 16),
        ), text
    control = re.findall(
        r"^\| ([0-9A-F]{2})(?: \(\w+\))? \| ((?:R\w+ ?)+) \| ((?:R\w+ ?)+) \|$",
        text_of("protocol.md"),
        re.MULTILINE,
    )
    assert len(control) == 5
    for byte, bare, addressed in control:
        assert {_check_byte(text, "") for text in bare.split()} == {int(byte, 16)}
        assert {_check_byte(text, "0001") for text in addressed.split()} == {int(byte, 16)}


# -- events ----------------------------------------------------------------------------------------

KIND = re.compile(r"[a-z_]+(?:\.[a-z_]+)+")
SETTINGS = set(COMMAND_OF)
NO_KINDS = {"guard.lock"}
ENDS_OF_FILES = {"html", "json", "jsonl", "parquet", "pdf", "toml", "txt", "typ"}
PATTERNS = {
    "read": ("timeout", "bcc", "format", "implausible", "pulled"),
    "alarm": ("high", "low"),
    "station": ("completed", "stopped", "refused", "gone", "not_started", "left_out", "failed"),
    "alarm.episode": tuple(one.value for one in Transition),
}
"""Kinds that are put together when they are told."""


def kinds_in_code() -> set[str]:
    """Texts in the code that look like kinds and begin like one that the page has."""
    listed = {kind.partition(".")[0] for kind in kinds_on_page()}
    sources = [path.read_text(encoding="utf-8") for path in (ROOT / "jbclog").rglob("*.py")]
    texts = {text for source in sources for text in re.findall(rf'"({KIND.pattern})"', source)}
    found = {text for text in texts if text.partition(".")[0] in listed}
    return {
        text for text in found - SETTINGS - NO_KINDS if text.rpartition(".")[2] not in ENDS_OF_FILES
    }


def kinds_on_page() -> set[str]:
    cells = re.findall(r"^\| (`.+?`) \| ", text_of("events.md"), re.MULTILINE)
    return {kind for cell in cells for kind in re.findall(r"`([a-z_.]+?)…?`", cell) if "." in kind}


def test_every_kind_of_event_is_listed_and_every_listed_one_exists() -> None:
    code, page = kinds_in_code(), kinds_on_page()
    made = {f"{begin}.{end}" for begin, ends in PATTERNS.items() for end in ends} | {"read.nak"}
    made |= {
        f"alarm.{side}.{end}" for side in PATTERNS["alarm"] for end in ("ended", "not_working")
    }
    assert sorted(code - page - {"alarm.episode"}) == []
    assert sorted(page - code - made) == []


def test_the_kinds_that_can_be_chosen_are_those_of_the_page() -> None:
    of_a_record = text_of("events.md").split("## Findings")[0]
    cells = re.findall(r"^\| (`.+?`) \| (.+)", of_a_record, re.MULTILINE)
    listed = {
        kind
        for names, when in cells
        if not when.startswith("annotation")
        for kind in re.findall(r"`([a-z_.]+?)…?`", names)
    }
    assert set(KINDS) == listed


# -- safe states -----------------------------------------------------------------------------------


def test_the_safe_states_are_those_of_the_families() -> None:
    rows = re.findall(
        r"^\| (`.+?`) \| (.+?) \| (.+?) \| .+ \|$", text_of("safe-states.md"), re.MULTILINE
    )
    said = {
        family: tuple(re.findall(r"`(\w+)`", " ".join(states)))
        for names, *states in rows
        for family in re.findall(r"`(\w+)`", names)
    }
    assert said == {name: family.safe_states for name, family in FAMILIES.items()}


# -- families, benchmarks, glossary ----------------------------------------------------------------


def test_the_families_are_those_that_are_driven() -> None:
    assert set(re.findall(r"^\| `(\w+)` \|", text_of("families.md"), re.MULTILINE)) - {
        "family"
    } == set(FAMILIES)


def test_each_benchmark_has_one_row() -> None:
    listed = re.findall(
        r"^\| [^|]*`python (tests/bench/bench_\w+\.py)\b", text_of("benchmarks.md"), re.MULTILINE
    )
    there = (ROOT / "tests" / "bench").glob("bench_*.py")
    assert sorted(listed) == sorted(path.relative_to(ROOT).as_posix() for path in there)


def test_the_glossary_is_in_order() -> None:
    terms = re.findall(r"^\| (.+?) \| .+ \|$", text_of("glossary.md"), re.MULTILINE)[2:]
    assert terms == sorted(set(terms), key=str.lower)
