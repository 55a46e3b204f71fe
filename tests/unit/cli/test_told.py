"""What the terminal says at a run's end."""

from __future__ import annotations

from jbclog.analysis.verdict import Result, Rule
from jbclog.cli.output import wrapped
from jbclog.cli.run import verdict_reasons
from jbclog.core.outcome import Exit, RunFinding, in_order, tools_text
from support.records.sealed_run import station


def rule(
    name: str, place: tuple[str, int | None] | tuple[None, None], result: Result, text: str
) -> dict[str, object]:
    return Rule(name, *place, None, None, "", result, text).as_dict()


def test_tools_that_are_safe_are_counted() -> None:
    assert (
        tools_text([station("dde-1", (1, 2)), station("ucr-1")])
        == "3 tools are in their safe state, as read back"
    )
    assert tools_text([station("ucr-1")]) == "1 tool is in its safe state, as read back"


def test_tools_that_are_not_are_named() -> None:
    sent, never = station("dde-1", (1, 2)), station("ucr-1")
    sent.safe_state[2] = "sent"
    never.safe_state.clear()  # its session broke before it came to that
    assert (
        tools_text([sent, never])
        == "safe state NOT confirmed: dde-1 port 2, ucr-1 port 1; confirmed for 1 of 3 tools"
    )


def test_no_tool_was_touched() -> None:
    facts = station("dde-1", (1, 2))
    facts.touched, facts.safe_state = [], {}
    assert tools_text([facts]) == "no tool was touched"


def test_equal_reasons_stand_once_the_gravest_first() -> None:
    unseen = "The tool was not seen idle for long enough to say."
    rules = [
        rule("alarms", ("ucr-1", None), Result.PASS, "0 counted; 0 allowed."),
        *(
            rule(
                name,
                ("dde-1", port),
                Result.MISSING,
                f"Port {port}: {unseen[0].lower()}{unseen[1:]}",
            )
            for name in "ab"
            for port in (1, 2)
        ),
        rule("a", ("ucr-1", 1), Result.MISSING, unseen),
        rule("record", (None, None), Result.MISSING, "The record is not whole."),
        rule("coverage", ("dde-1", 2), Result.FAIL, "90 % are there."),
    ]
    assert verdict_reasons(rules) == [
        "fail: dde-1 port 2: 90 % are there. (coverage)",
        f"missing: dde-1 ports 1, 2; ucr-1 port 1: {unseen} (a, b)",
        "missing: The record is not whole. (record)",
    ]


def test_findings_come_by_severity() -> None:
    codes = [Exit.NOT_FINE, Exit.STATION, Exit.INTERRUPTED, Exit.UNSAFE, Exit.STATION, Exit.RECORD]
    found = in_order(RunFinding(code, str(place)) for place, code in enumerate(codes))
    assert [(one.code.value, one.text) for one in found] == [
        (5, "3"),
        (4, "5"),
        (3, "1"),
        (3, "4"),
        (130, "2"),
        (1, "0"),
    ]


def test_long_lines_are_broken_between_words_only() -> None:
    text = (
        "  12:00:00Z  error  dde-1: "
        + "the alarm limit was found changed " * 4
        + "/dev/serial/by-id/"
        + "x" * 60
    )
    lines = wrapped(text, 60).split("\n")
    assert " ".join(lines).split() == text.split()
    assert all(len(line) < 60 for line in lines[:-1])
    assert all(line.startswith("  ") for line in lines)
    assert wrapped("one\n\n  two", 80) == "one\n\n  two"
