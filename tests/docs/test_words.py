"""What must not stand in the project: paths of somebody's machine, hosts of package registries,
leftovers.
"""

from __future__ import annotations

import re

import pytest

from support.readers.repository import TEXTS
from support.readers.texts import ROOT

FORBIDDEN = {
    "a path of somebody's machine": re.compile(
        r"(?<![\w.:/~$}-])/(?:home|root|Users|work|mnt|srv|workspace)/\w"
    ),
    "the host of a package registry": re.compile(
        r"py" r"pi\.|python" r"hosted|--(?:extra-)?index" r"-url|--find" r"-links"
    ),
    "something that is not finished": re.compile(
        r"\b(?:TO" r"DO|FIX" r"ME|XX" r"X)\b|NotImplemented" r"Error"
    ),
}


@pytest.mark.parametrize("what", FORBIDDEN)
def test_nothing_of_this_stands_anywhere(what: str) -> None:
    found = [
        f"{name}:{number}"
        for name in TEXTS
        for number, line in enumerate((ROOT / name).read_text(encoding="utf-8").splitlines(), 1)
        if FORBIDDEN[what].search(line)
    ]
    assert found == []


def test_the_lock_pins_everything_by_version_and_hash() -> None:
    lock = (ROOT / ".ci" / "requirements.lock").read_text()
    entries = re.split(r"\n(?=\w)", lock.partition("\n\n")[2] or lock)
    pinned = [entry for entry in entries if not entry.startswith("#")]
    assert len(pinned) > 20
    assert [entry for entry in pinned if "==" not in entry or "--hash=sha256:" not in entry] == []
    assert "://" not in lock
