"""Every example names the page of its manual, and none is lost: the pages against the manuals'
contents, the counts by kind.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from types import ModuleType
from typing import NamedTuple

import pytest

from support.golden import JBC, manual_003

KINDS = ("FRAMES", "FIELDS", "LISTED", "REFUSALS", "WHOLE", "ADDRESSES")
COUNTED = {
    "000": {"FRAMES": 74, "FIELDS": 43, "LISTED": 37, "REFUSALS": 7},
    "001": {"FRAMES": 39, "FIELDS": 37, "LISTED": 30, "REFUSALS": 7},
    "002": {"FRAMES": 110, "FIELDS": 40, "LISTED": 43, "REFUSALS": 7, "WHOLE": 4},
    "004": {"FRAMES": 75, "FIELDS": 20, "LISTED": 32, "REFUSALS": 7, "WHOLE": 2, "ADDRESSES": 5},
}
"""How many a search of the manuals found, by the rule in `golden`'s docstring; each was then found
there on its page.
"""


class Place(NamedTuple):
    """Where an example says that it stands."""

    kind: str
    manual: str
    section: str
    page: int
    printed: str


def places(module: ModuleType) -> Iterator[Place]:
    for kind in KINDS:
        for where, page, printed, *_ in getattr(module, kind, []):
            yield Place(kind, where[:3], where[4:], page, printed)


def begins(module: ModuleType) -> dict[str, int]:
    return {section: page for page, sections in module.CONTENTS.items() for section in sections}


def ends(module: ModuleType) -> dict[str, int]:
    """The page on which the next section begins: the last on which one's content can be."""
    sections = list(begins(module).items())
    return {section: after for (section, _), (_, after) in pairwise(sections)} | {
        sections[-1][0]: sections[-1][1]
    }


every_manual = pytest.mark.parametrize("module", JBC, ids=lambda module: module.__name__[-3:])


@every_manual
def test_every_example_is_on_a_page_of_its_section(module: ModuleType) -> None:
    first, last = begins(module), ends(module)
    wrong = [
        one
        for one in places(module)
        if not first.get(one.section, 10**6) <= one.page <= last[one.section]
    ]
    assert wrong == []


@every_manual
def test_the_contents_are_in_the_order_of_the_pages(module: ModuleType) -> None:
    pages = list(module.CONTENTS)
    assert pages == sorted(pages)
    sections = [section for one in module.CONTENTS.values() for section in one]
    assert len(sections) == len(set(sections))


@every_manual
def test_only_in_the_manual_with_page_ends_does_a_section_go_on(module: ModuleType) -> None:
    """In the others the page of an example is the one on which its section or row begins."""
    first = begins(module)
    behind = {(one.section, one.page) for one in places(module) if one.page != first[one.section]}
    assert behind == ({("3.1", 8), ("4.9.13", 15)} if module.__name__.endswith("001") else set())


@every_manual
def test_none_is_lost(module: ModuleType) -> None:
    found = list(places(module))
    assert {one.manual for one in found} == {module.__name__[-3:]}
    assert Counter(one.kind for one in found) == COUNTED[module.__name__[-3:]]


@every_manual
def test_none_stands_twice(module: ModuleType) -> None:
    of_frames = [(one.where, one.printed, one.bare) for one in module.FRAMES]
    of_fields = [(one.where, one.printed, one.text) for one in module.FIELDS]
    of_lists = [(one.where, one.printed, one.data) for one in module.LISTED]
    for found in (of_frames, of_fields, of_lists):
        assert [one for one, times in Counter(found).items() if times > 1] == []


@every_manual
def test_every_section_about_a_code_has_an_example(module: ModuleType) -> None:
    """No heading or row of a command is without: what the search rule asks for."""
    about_codes = {
        one
        for one in begins(module)
        if (one[0] in "RW" and one != "With no address") or one.count(".") == 2
    }
    assert about_codes - {one.section for one in places(module)} == set()


def test_what_of_omega_is_printed_is_on_the_one_page_that_there_is() -> None:
    assert {one.page for one in manual_003.FRAMES} | {page for _, page, *_ in manual_003.SUMS} == {
        5
    }
    assert {one.page for one in manual_003.BY_HAND} == {None}
    assert (len(manual_003.FRAMES), len(manual_003.SUMS), len(manual_003.BY_HAND)) == (4, 2, 12)
