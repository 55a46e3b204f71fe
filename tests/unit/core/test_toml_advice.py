"""What editors and habits leave in a TOML file, in words, with the column and the remedy."""

from __future__ import annotations

import pytest

from jbclog.core.errors import Problems
from jbclog.core.toml import parse

STRAIGHT = 'use a straight quote, "'
EITHER = "use a straight quote, ' or \""
SPACE = "use an ordinary space"
MINUS = "use a plain minus, -"

SENTENCES = {
    "name = “x”": f"typographic quote “ at column 8; {STRAIGHT}",
    'name = "x”': f"typographic quote ” at column 10; {STRAIGHT}",
    "name = „x“": f"typographic quote „ at column 8; {STRAIGHT}",
    "name = «x»": f"typographic quote « at column 8; {STRAIGHT}",
    "name = ‘x’": f"typographic quote ‘ at column 8; {EITHER}",
    "name = `x`": f"typographic quote ` at column 8; {EITHER}",
    'families = ["dde", “dme”]': f"typographic quote “ at column 20; {STRAIGHT}",
    "“name” = 1": f"typographic quote “ at column 1; {STRAIGHT}",
    "[“recipe”]": f"typographic quote “ at column 2; {STRAIGHT}",
    "delay_s\u00a0= 1": f"no-break space (U+00A0) at column 8; {SPACE}",
    "\u00a0 delay_s = 1": f"no-break space (U+00A0) at column 1; {SPACE}",
    "delay_s =\u202f1": f"narrow no-break space (U+202F) at column 10; {SPACE}",
    "delay_s =\u30001": f"ideographic space (U+3000) at column 10; {SPACE}",
    "\u200bdelay_s = 1": "zero width space (U+200B) at column 1; remove it",
    "\ufeffdelay_s = 1": "byte order mark (U+FEFF) at column 1; remove it",
    "delay_s = \x001": "control character (U+0000) at column 11; remove it",
    "delay_s = 0,5": "decimal comma; write 0.5, not 0,5",
    "delay_s=-12,25 # s": "decimal comma; write -12.25, not -12,25",
    "limit_c = 1.234,5": "decimal comma; write 1234.5, not 1.234,5",
    "at = { offset_c = 0,5 }": "decimal comma; write 0.5, not 0,5",
    "offset_c = −5": f"minus sign − at column 12; {MINUS}",
    "offset_c = –5": f"en dash – at column 12; {MINUS}",
    "limit_c = 350 °C": "degree sign ° at column 15; write a number alone, a text in quotes",
    "größe = 1": "letter ö at column 3; it is allowed in quotes only",
    "delay_s ＝ 1": "fullwidth equals sign ＝ at column 9; use =",
    "day = 2026-11-21\t08:00:00": "tab between date and time at column 17; use a space or T",
    "day = 2026-11-21\t\t08:00:00": "tab between date and time at column 17; use a space or T",
    "day = 21.11.2026": "date; write 2026-11-21, not 21.11.2026",
    "day = 1.2.2026": "date; write 2026-02-01, not 1.2.2026",
    "a = 1\rb = 2": "its lines end with CR alone; save it with LF or CR LF as line ends",
    "# all\rof\rit": "its lines end with CR alone; save it with LF or CR LF as line ends",
}


def told(text: str) -> tuple[int | None, str]:
    with pytest.raises(Problems) as refused:
        parse(text, "x.toml")
    (problem,) = refused.value.problems
    return problem.line, problem.text


@pytest.mark.parametrize("line", SENTENCES)
def test_a_line_is_explained(line: str) -> None:
    assert told(f'# “comment” 0,5\nother = "“text” 0,5"\n{line}\nlast = 1\n') == (
        3,
        SENTENCES[line],
    )


@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_lines_of_the_same_kind_are_counted(end: str) -> None:
    lines = ["[a]", "b = “x”", "c = 0,5", "d = ‘y’", 'e = "“"', "f = „z“", ""]
    line, text = told(end.join(lines))
    assert line == 2
    assert text == f"typographic quote “ at column 5; {STRAIGHT} (also in 2 more lines)"
    assert told(end.join(lines[:4]))[1].endswith("(also in 1 more line)")


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("a = 'x “y” 0,5' b", "Expected newline or end of document after a statement"),
        ("a = 1 2 # – °", "Expected newline or end of document after a statement"),
        ("a", "Expected '=' after a key in a key/value pair"),
    ],
)
def test_what_stands_in_quotes_and_comments_is_not_blamed(line: str, text: str) -> None:
    assert told(f"{line}\nb = 1\n") == (1, f"this is not TOML: {text}")


@pytest.mark.parametrize(
    "text",
    [
        *("a = [0,5]", 'a = "0,5 °C “x”" # – ”', "a = 2026-11-21 08:00:00", "\ufeffa = 1\r\n"),
        *("a\t=\t1", '"größe" = 1', "a = 1.2"),
    ],
)
def test_what_is_toml_stays_so(text: str) -> None:
    assert "a" in parse(text, "x.toml").tables or "größe" in parse(text, "x.toml").tables
