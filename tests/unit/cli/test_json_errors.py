"""With --json every command that refuses what was typed prints one JSON object with the text of the
error and the exit code.
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from jbclog.cli import output
from jbclog.core.text import clean
from support.invoked import invoked
from support.readers.command_line import VERBS

WITH_JSON = sorted(verb for verb, options in VERBS.items() if "--json" in options)
LINE = ("--line", "gone.toml")
GONE = {
    "plan": ("gone.toml", *LINE),
    "run": ("gone.toml", *LINE),
    "batch": ("gone.toml",),
    "safe": LINE,
    "recover": ("gone",),
    "doctor": LINE,
    "read": ("dde-1", *LINE),
    "write": ("dde-1", "sleep_delay", "5", *LINE),
    "runs": ("gone",),
    "report": ("gone",),
    "check": ("gone",),
    "export": ("gone", "--to", "csv"),
    "alarms": ("gone",),
    "annotate": ("gone", "text"),
    "compare": ("gone", "gone"),
    "trend": ("gone",),
    "chart": ("gone",),
    "limits": ("show", "gone"),
    "verify": (
        "dde-1",
        "-p1",
        *LINE,
        "--reading",
        "350",
        "--instrument",
        "A",
        "--due",
        "2099-01-01",
        "--tip",
        "T",
        "--by",
        "A",
    ),
    "audit": (*LINE, "--ledger", "gone.jsonl"),
    "maintenance": ("done", "--station", "dde-1", "--task", "tip-change", "--ledger", "gone.jsonl"),
    "where-used": ("gone", "--station", "dde-1", "--port", "1"),
    "publish": ("gone", "plant"),
    "demo": ("--seconds", "1"),
    "scan": ("--addresses", "x"),
}


def refused(*arguments: str) -> tuple[dict[str, object], str]:
    ended = invoked(*arguments, "--json")
    (line,) = ended.stdout.splitlines()
    told = json.loads(line)
    assert set(told) == {"error", "problems", "exit_code"}
    assert told["exit_code"] == ended.exit_code
    for text in told["problems"]:
        assert clean(text) in " ".join(ended.stderr.split()), ended.stderr
    return told, " ".join(told["problems"])


def test_each_command_with_json_is_tried() -> None:
    assert sorted(GONE) == WITH_JSON


@pytest.mark.parametrize("verb", GONE)
def test_what_is_not_there_is_named(
    verb: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    told, text = refused(verb, *GONE[verb])
    assert told["exit_code"] == 2
    assert ("gone" in text) is ("gone" in " ".join(GONE[verb])), text


@pytest.mark.parametrize("verb", GONE)
def test_an_option_that_does_not_exist_is_named(verb: str) -> None:
    told, text = refused(verb, *GONE[verb], "--no-such-option")
    assert (told["error"], told["exit_code"]) == ("UsageError", 2)
    assert "--no-such-option" in text


@pytest.mark.parametrize(
    ("verb", "option"),
    [("run", "--line"), ("audit", "--line"), ("verify", "--line"), ("where-used", "--station")],
)
def test_an_option_that_is_missing_is_named(verb: str, option: str) -> None:
    arguments = {"verify": ("dde-1",)}.get(verb, ())
    assert option in refused(verb, *arguments)[1]


def test_an_internal_error_has_its_text_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("JBCLOG_TRACEBACK", raising=False)

    def fails(as_json: bool) -> None:
        raise ZeroDivisionError("division by zero")

    with pytest.raises(output.typer.Exit):
        output.reports_errors(fails)(as_json=True)
    out, err = capsys.readouterr()
    told = json.loads(out)
    assert (told["error"], told["exit_code"]) == ("ZeroDivisionError", 1)
    assert "division by zero" in told["problems"][0]
    assert told["problems"][0] in err
