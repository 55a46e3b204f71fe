"""A command that reads records limits its own memory; a recorder and the library never do."""

from __future__ import annotations

import resource
import subprocess
import sys

import pytest

from jbclog.core import operating_system
from jbclog.core.operating_system import LEAST_BYTES, limit_bytes

SHOW = """
import resource, sys
import jbclog.cli.app as app
app.app = lambda: print(resource.getrlimit(resource.RLIMIT_AS)[0])
sys.argv = ["jbclog", *sys.argv[1:]]
app.main()
"""
ALL_OF_IT = """
import sys
import jbclog.cli.app as app
app.app = lambda: bytearray(1 << 50)
sys.argv = ["jbclog", *sys.argv[1:]]
app.main()
"""


def ended(code: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", code, *words], capture_output=True, text=True, check=False
    )


def limit_of(*words: str) -> int:
    return int(ended(SHOW, *words).stdout)


def test_a_command_that_reads_has_the_limit_that_doctor_shows() -> None:
    assert limit_of("runs", "x") == limit_of("export") == limit_bytes()


@pytest.mark.parametrize("words", [(), ("run",), ("watch",), ("recover",), ("batch",), ("--help",)])
def test_no_other_command_changes_its_limit(words: tuple[str, ...]) -> None:
    assert limit_of(*words) == resource.getrlimit(resource.RLIMIT_AS)[0]


def test_the_library_limits_nothing() -> None:
    before = resource.getrlimit(resource.RLIMIT_AS)
    call = (
        "import resource, jbclog; jbclog.open_runs('.').found;"
        " print(resource.getrlimit(resource.RLIMIT_AS))"
    )
    assert ended(call).stdout == f"{before}\n"


def test_a_refusal_is_one_line_and_exit_code_4() -> None:
    read = ended(ALL_OF_IT, "check", "x")
    assert (read.returncode, len(read.stderr.splitlines())) == (4, 1)
    assert "`jbclog doctor` shows the limit" in read.stderr


@pytest.mark.parametrize(
    ("pages", "soft", "limit"),
    [
        (10 << 20, resource.RLIM_INFINITY, 40 << 30),
        (1 << 18, resource.RLIM_INFINITY, LEAST_BYTES),
        (10 << 20, 3 << 30, 3 << 30),
    ],
)
def test_the_limit_is_the_memory_at_least_4_gib_and_never_above_one_that_is_set(
    pages: int, soft: int, limit: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = {"SC_PHYS_PAGES": pages, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(operating_system.os, "sysconf", known.__getitem__)
    monkeypatch.setattr(
        operating_system.resource, "getrlimit", lambda _: (soft, resource.RLIM_INFINITY)
    )
    assert limit_bytes() == limit


def test_a_system_without_the_limit_has_none(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(operating_system.resource, "RLIMIT_AS")
    assert limit_bytes() is None
