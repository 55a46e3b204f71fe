"""`jbclog init`: a first line file and recipe, by questions."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from jbclog.cli import options
from jbclog.cli.output import note, reports_errors
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.config.line import Described

T = TypeVar("T")
SCAN, HAND = "scan", "hand"


@reports_errors
def init(
    ctx: typer.Context,
    folder: Path = typer.Argument(
        Path(), metavar="DIR", help="Folder for line.toml and recipe.toml; made if needed."
    ),
) -> None:
    """Write a first line file and recipe, by questions.

    Finds the stations by a scan, which sends only queries, or asks you for their ports and
    families. Writes both files after the last question, and overwrites none.

    \b
    Example:
      jbclog init
    """
    from jbclog.app.first_files import LINE, files, kinds_of

    _expect_free(folder / LINE)
    how = _answer(
        "Find the stations by a scan, or enter them by hand (scan, hand)", _one_of(SCAN, HAND), SCAN
    )
    stations = _scanned(options.port_access(ctx)) if how == SCAN else _entered(folder)
    name = _answer("Name of the recipe", _name, "first-recipe")
    celsius = {
        kind.name: _answer(kind.question, _celsius(kind.allowed_c), str(kind.usual_c))
        for kind in kinds_of(stations)
        if kind.question is not None
    }
    written = list(files(stations, name, celsius, folder))
    _expect_free(*(path for path, _ in written))
    for path, text in written:
        _write(path, text)
    line, *recipes = (str(path) for path, _ in written)
    note(f"written: {line}, {', '.join(recipes)}. Nothing was written to a station.")
    note(f"Next: jbclog plan --line {line}")


def _expect_free(*files: Path) -> None:
    """Raise `UsageError` if a file exists."""
    for file in files:
        if file.exists() or file.is_symlink():
            raise UsageError(
                f"{file}: exists; init overwrites nothing. Edit it, or give another folder: jbclog"
                " init DIR"
            )


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as error:
        raise UsageError(f"{path}: cannot write: {error.strerror}") from error


# -- stations --------------------------------------------------------------------------------------


def _scanned(access: PortAccess) -> list[Described]:
    """Scan, and return the stations found. Raises `UsageError` if there are none."""
    from jbclog.app.discovery import described, search
    from jbclog.cli.scan import print_progress
    from jbclog.session.discovery.found import plan_for
    from jbclog.transport.system_ports import usb_ports

    usual = " ".join(port.name for port in usb_ports())
    none = "" if usual else " (no USB adapter was found here)"
    urls = _answer(f"Ports to scan, with blanks between them{none}", _urls, usual or None)
    plans = [(url, plan_for(url, limit_s=None)) for url in urls]
    reports = search(plans, lambda report: print_progress(report, quiet=False), access)
    stations = described(reports)
    if not stations:
        raise UsageError(
            f"no station found on {', '.join(urls)}; `jbclog scan PORT` shows what was tried,"
            " `jbclog doctor` why"
        )
    return stations


def _entered(folder: Path) -> list[Described]:
    """Ask for stations until there are no more."""
    from jbclog.app.first_files import files, station
    from jbclog.core.errors import Problems

    stations: list[Described] = []
    while True:
        family = _answer(
            "Family of the station (dde, nae, dme, hde, ucr, ale, soldering, jtse, omega)", _family
        )
        url = _answer(
            "Its port (/dev/serial/by-id/..., COM3, socket://HOST:PORT or rfc2217://HOST:PORT)",
            _url,
        )
        usual = f"{family}-{1 + sum(one.family == family for one, _ in stations)}"
        new = [*stations, station(_answer("Its name", _name, usual), url, family)]
        try:
            next(files(new, "recipe", {}, folder))
        except Problems as wrong:
            note(
                *(f"error: {problem}" for problem in wrong.problems),
                "This station is not taken; enter it again.",
            )
            continue
        stations = new
        if _answer("Another station (yes, no)", _one_of("yes", "no"), "no") == "no":
            return stations


# -- answers ---------------------------------------------------------------------------------------


def _answer(question: str, read: Callable[[str], T], usual: str | None = None) -> T:
    """Ask until `read` accepts the answer; an empty one is `usual`."""
    answer: T = typer.prompt(question, default=usual, value_proc=read, err=True)
    return answer


def _one_of(*words: str) -> Callable[[str], str]:
    def read(text: str) -> str:
        found = [word for word in words if word.startswith(text.strip().lower())]
        if len(found) != 1 or not text.strip():
            raise typer.BadParameter(f"must be {' or '.join(words)}")
        return found[0]

    return read


def _family(text: str) -> str:
    from jbclog.config.schema import unknown
    from jbclog.protocol.commands.family import FAMILIES

    name = text.strip().lower()
    if name not in FAMILIES:
        raise typer.BadParameter(f"{text.strip()}: {unknown(name, [*FAMILIES])}")
    return name


def _url(text: str) -> str:
    from jbclog.config.line import url_problem

    problem = url_problem(text.strip())
    if not text.strip() or problem:
        raise typer.BadParameter(problem or "a port is required")
    return text.strip()


def _urls(text: str) -> list[str]:
    urls = list(dict.fromkeys(_url(one) for one in text.split()))
    if not urls:
        raise typer.BadParameter("a port is required")
    return urls


def _name(text: str) -> str:
    from jbclog.config.schema import NAME_ALLOWED, NAME_PATTERN

    if not re.fullmatch(NAME_PATTERN, text.strip()):
        raise typer.BadParameter(f"must be {NAME_ALLOWED}")
    return text.strip()


def _celsius(allowed: range) -> Callable[[str], int]:
    def read(text: str) -> int:
        if not text.strip().isdecimal() or int(text) not in allowed:
            steps = f" in steps of {allowed.step}" if allowed.step > 1 else ""
            raise typer.BadParameter(f"must be whole °C, {allowed[0]} to {allowed[-1]}{steps}")
        return int(text)

    return read
