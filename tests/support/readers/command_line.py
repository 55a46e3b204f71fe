"""The command line's verbs and options, as the program itself knows them."""

from __future__ import annotations

import re
import shlex

from typer.main import get_command

from jbclog.cli.app import app

_COMMANDS = get_command(app).commands  # type: ignore[attr-defined]  # a group, which the type does not tell
VERBS: dict[str, set[str]] = {
    name: (
        {
            option
            for parameter in command.params
            for option in parameter.opts
            if option.startswith("-")
        }
        | {"--help", "-h"}
    )
    for name, command in _COMMANDS.items()
}
"""Verb -> its options."""
HELP: dict[str, str] = {name: command.help or "" for name, command in _COMMANDS.items()}

_CALL = re.compile(r"(?:^|[\s(/])jbclog((?:[ \t]+(?:'[^']*'|\"[^\"]*\"|[^\s)]+))+)")


def calls(text: str) -> list[list[str]]:
    """Every `jbclog VERB ...` in a text, as words; also those with a placeholder such as VERB or
    RECIPE.
    """
    found = (shlex.split(arguments, comments=True) for arguments in _CALL.findall(text))
    return [words for words in found if words and words[0] != "VERB"]


def wrong(words: list[str]) -> str | None:
    """What is wrong with a call, or None: a verb or an option that there is not."""
    verb = words[0]
    if verb in ("--help", "--version", "--install-completion", "--show-completion", "-h"):
        return None
    if verb not in VERBS:
        return f"jbclog {verb}: there is no such verb"
    unknown = [word for word in words[1:] if word.startswith("-") and word not in VERBS[verb]]
    return f"jbclog {verb} has no {unknown[0]}" if unknown else None
