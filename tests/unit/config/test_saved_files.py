"""Files of all kinds as people save them: each is refused with the line, the character and the
remedy, or read.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from jbclog.config.jobs_file import load_jobs
from jbclog.config.line import load_line
from jbclog.config.load_recipe import load_recipe
from jbclog.config.tasks_file import load_tasks
from jbclog.core.errors import Problems
from support.invoked import invoked


class Kind(NamedTuple):
    """A kind of file. `quoted`: a text in it; `number`: an assignment of a number."""

    load: Callable[[Path], object]
    text: str
    quoted: str
    number: str


KINDS = {
    "recipe": Kind(
        load_recipe,
        '[recipe]\nname = "job"\nrevision = 1\nfamilies = ["dde"]\n[alarm.high]\nlimit_c = 400\n'
        "delay_s = 0.5\n",
        '"job"',
        "delay_s = 0.5",
    ),
    "line": Kind(
        load_line,
        '[line]\nname = "bench"\n[[station]]\nname = "dde-1"\nurl = "COM3"\nfamily = "dde"\n'
        "[station.sim]\njoints_per_minute = 0.5\n",
        '"bench"',
        "joints_per_minute = 0.5",
    ),
    "jobs": Kind(
        load_jobs,
        '[[job]]\nname = "night"\nrecipe = "job.toml"\nduration = "1m"\nrate = 0.5\n'
        '[batch]\nline = "line.toml"\n',
        '"night"',
        "rate = 0.5",
    ),
    "tasks": Kind(
        load_tasks,
        '[[task]]\nname = "cleaning"\ncounter = "work_h"\nlife_h = 0.5\n',
        '"cleaning"',
        "life_h = 0.5",
    ),
}
UTF_16 = 'is UTF-16 ("Unicode" in Windows and Excel); save it as UTF-8'
LONE_CR = "its lines end with CR alone; save it with LF or CR LF as line ends"


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


def told(kind: Kind, path: Path, data: bytes) -> list[tuple[int | None, str]]:
    path.write_bytes(data)
    with pytest.raises(Problems) as refused:
        kind.load(path)
    return [(problem.line, problem.text) for problem in refused.value.problems]


def line_of(kind: Kind, text: str) -> int:
    return kind.text[: kind.text.index(text)].count("\n") + 1


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_utf_8_is_read(kind: Kind, tmp_path: Path, encoding: str, end: str) -> None:
    text = f"# 350 °C{end}{kind.text}".replace("\n", end).replace("\r\r", "\r")
    (tmp_path / "x.toml").write_bytes(text.encode(encoding))
    assert kind.load(tmp_path / "x.toml")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16(kind: Kind, tmp_path: Path, encoding: str) -> None:
    assert told(kind, tmp_path / "x.toml", kind.text.encode(encoding)) == [(None, UTF_16)]


@pytest.mark.parametrize("sign", ["°", "ä"])
def test_latin_1(kind: Kind, tmp_path: Path, sign: str) -> None:
    data = f"{kind.text}# {sign}\n".encode("latin-1")
    line = kind.text.count("\n") + 1
    code = f"0x{ord(sign):02X}"
    why = f'byte {code} at column 3 is not UTF-8 ("{sign}" in Latin-1); save the file as UTF-8'
    assert told(kind, tmp_path / "x.toml", data) == [(line, why)]


def test_a_byte_that_is_no_text(kind: Kind, tmp_path: Path) -> None:
    why = "byte 0x81 at column 1 is not UTF-8; save the file as UTF-8"
    assert told(kind, tmp_path / "x.toml", b"\n\x81" + kind.text.encode()) == [(2, why)]


def test_lines_that_end_with_cr_alone(kind: Kind, tmp_path: Path) -> None:
    data = kind.text.replace("\n", "\r").encode()
    assert told(kind, tmp_path / "x.toml", data) == [(1, LONE_CR)]


@pytest.mark.parametrize("quotes", ["“”", "„“", "””", "«»"])
def test_typographic_quotes(kind: Kind, tmp_path: Path, quotes: str) -> None:
    typed = kind.quoted.replace('"', quotes[0], 1).replace('"', quotes[1])
    data = kind.text.replace(kind.quoted, typed).encode()
    why = f'typographic quote {quotes[0]} at column 8; use a straight quote, "'
    assert told(kind, tmp_path / "x.toml", data) == [(line_of(kind, kind.quoted), why)]


def test_no_break_spaces(kind: Kind, tmp_path: Path) -> None:
    data = kind.text.replace(kind.number, kind.number.replace(" =", "\u00a0=")).encode()
    column = kind.number.index(" ") + 1
    why = f"no-break space (U+00A0) at column {column}; use an ordinary space"
    assert told(kind, tmp_path / "x.toml", data) == [(line_of(kind, kind.number), why)]


def test_decimal_commas(kind: Kind, tmp_path: Path) -> None:
    data = kind.text.replace("0.5", "0,5").encode()
    why = "decimal comma; write 0.5, not 0,5"
    assert told(kind, tmp_path / "x.toml", data) == [(line_of(kind, kind.number), why)]


def test_tabs_in_dates(kind: Kind, tmp_path: Path) -> None:
    data = kind.text.replace("0.5", "2026-11-21\t08:00:00").encode()
    column = kind.number.index("0.5") + 11
    why = f"tab between date and time at column {column}; use a space or T"
    assert told(kind, tmp_path / "x.toml", data) == [(line_of(kind, kind.number), why)]


def test_a_command_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "line.toml").write_text(KINDS["line"].text.replace('"bench"', "“bench”"))
    (tmp_path / "job.toml").write_bytes(KINDS["recipe"].text.encode("utf-16"))
    ended = invoked("plan", "job.toml", "--line", "line.toml")
    assert ended.exit_code == 2
    assert ended.stderr.splitlines() == [
        'error: line.toml:2: typographic quote “ at column 8; use a straight quote, "',
        f"error: job.toml: {UTF_16}",
        "2 problems; nothing sent",
    ]
