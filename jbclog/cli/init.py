"""`jbclog init`: a first line file and recipe, by questions."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from jbclog.cli import options
from jbclog.cli.output import note, reports_errors
from jbclog.core.disk_space import write_failure
from jbclog.core.errors import UsageError

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.config.line import Described

T = TypeVar("T")
SCAN, HAND = "scan", "hand"
NO_TERMINAL = (
    "init: there is no terminal to answer its questions on; answer them with options:"
    " --scan PORT or --station FAMILY=PORT, --recipe NAME, --tip-c C, for hot air --air-c C"
)


@reports_errors
def init(
    ctx: typer.Context,
    folder: Path = typer.Argument(
        Path(), metavar="DIR", help="Folder for line.toml and recipe.toml; made if needed."
    ),
    scan: list[str] = typer.Option(
        [], metavar="PORT", help="Scan this port for a station; repeatable.", show_default=False
    ),
    station: list[str] = typer.Option(
        [],
        metavar="FAMILY=PORT",
        help="Station that is not scanned for; repeatable.",
        show_default=False,
    ),
    recipe: str | None = typer.Option(None, metavar="NAME", help="Name of the recipe."),
    tip_c: int | None = typer.Option(None, metavar="C", help="Tip temperature, °C."),
    air_c: int | None = typer.Option(None, metavar="C", help="Air temperature, °C."),
) -> None:
    """Write a first line file and recipe, by questions.

    Finds the stations by a scan, which sends only queries, or asks you for their ports and
    families. Asks for what no option answers. Writes both files after the last question, and
    overwrites none.

    \b
    Example:
      jbclog init --station dde=/dev/ttyUSB0 --recipe first --tip-c 350
    """
    from jbclog.app.first_files import LINE, files

    _expect_free(folder / LINE)
    given_c = {"tips": tip_c, "hot-air": air_c}
    try:
        stations = _stations(folder, scan, station, options.port_access(ctx))
        name = _given("--recipe", recipe, _name)
        if name is None:
            name = _answer("Name of the recipe", _name, "first-recipe")
        celsius = _temperatures(stations, given_c)
    except typer.Abort as end:
        if sys.stdin.isatty() or isinstance(end.__context__, KeyboardInterrupt):
            raise
        note("")  # ends the line of the question
        raise UsageError(NO_TERMINAL) from None
    written = list(files(stations, name, celsius, folder))
    _expect_free(*(path for path, _ in written))
    for path, text in written:
        _write(path, text)
    line, *recipes = (str(path) for path, _ in written)
    note(f"written: {line}, {', '.join(recipes)}. Nothing was written to a station.")
    note(f"Next: jbclog plan --line {line}")


def _stations(
    folder: Path, scan: list[str], by_hand: list[str], access: PortAccess
) -> list[Described]:
    """Return the stations of the options; without any, ask."""
    if scan or by_hand:
        ports = [_required("--scan", text, _url) for text in scan]
        return [*(_found_on(ports, access) if ports else []), *_named(by_hand)]
    how = _answer(
        "Find the stations by a scan, or enter them by hand (scan, hand)", _one_of(SCAN, HAND), SCAN
    )
    return _scanned(access) if how == SCAN else _entered(folder)


def _named(texts: list[str]) -> list[Described]:
    """Return the stations of ``FAMILY=PORT``."""
    from jbclog.app.first_files import station

    stations: list[Described] = []
    for text in texts:
        family, equals, port = text.partition("=")
        if not equals:
            raise UsageError(f"--station {text}: must be FAMILY=PORT, such as dde=/dev/ttyUSB0")
        name = _required("--station", family, _family)
        url = _required("--station", port, _url)
        stations.append(station(_usual_name(name, stations), url, name))
    return stations


def _usual_name(family: str, stations: list[Described]) -> str:
    return f"{family}-{1 + sum(known.family == family for known, _ in stations)}"


def _temperatures(stations: list[Described], given_c: dict[str, int | None]) -> dict[str, int]:
    """Return kind -> °C, as given or answered."""
    from jbclog.app.first_files import kinds_of

    celsius: dict[str, int] = {}
    for kind in kinds_of(stations):
        if kind.question is None:
            continue
        option = "--air-c" if kind.name == "hot-air" else "--tip-c"
        wanted = given_c[kind.name]
        read = _celsius(kind.allowed_c)
        given = _given(option, None if wanted is None else str(wanted), read)
        if given is None:
            given = _answer(kind.question, read, str(kind.usual_c))
        celsius[kind.name] = given
    return celsius


def _given(option: str, text: str | None, read: Callable[[str], T]) -> T | None:
    """Return the value of an option; None if it is not given. Raises `UsageError`."""
    return None if text is None else _required(option, text, read)


def _required(option: str, text: str, read: Callable[[str], T]) -> T:
    try:
        return read(text)
    except typer.BadParameter as error:
        why = str(error).removeprefix(f"{text}: ")
        raise UsageError(f"{option} {text}: {why}") from error


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
        raise UsageError(f"{path}: cannot write: {write_failure(error, path)}") from error


# -- stations --------------------------------------------------------------------------------------


def _scanned(access: PortAccess) -> list[Described]:
    """Ask for ports and scan them."""
    from jbclog.transport.system_ports import usb_ports

    usual = " ".join(port.name for port in usb_ports())
    none = "" if usual else " (no USB adapter was found here)"
    urls = _answer(f"Ports to scan, with blanks between them{none}", _urls, usual or None)
    return _found_on(urls, access)


def _found_on(urls: list[str], access: PortAccess) -> list[Described]:
    """Scan, and return the stations found. Raises `UsageError` if there are none."""
    from jbclog.app.discovery import described, search
    from jbclog.cli.scan import print_progress
    from jbclog.session.discovery.scan_plan import plan_for

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
        url = _answer(f"Its port ({_example_port()}, or socket://HOST:PORT)", _url)
        usual = _usual_name(family, stations)
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


def _example_port() -> str:
    """Return a port of this machine; the usual form where none is plugged in."""
    from jbclog.transport.system_ports import usb_ports

    plugged = [port.name for port in usb_ports()]
    return plugged[0] if plugged else "/dev/serial/by-id/..."


def _answer(question: str, read: Callable[[str], T], usual: str | None = None) -> T:
    """Ask until `read` accepts the answer, and say why it does not; an empty one is `usual`."""

    def checked(text: str) -> T:
        if not text.strip():
            raise typer.BadParameter("an answer is required; Ctrl-C ends without writing")
        return read(text)

    answer: T = typer.prompt(
        question,
        default=usual or "",
        show_default=usual is not None,
        value_proc=checked,
        err=True,
    )
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
    from jbclog.config.schema import name_problem

    problem = name_problem(text.strip())
    if problem is not None:
        raise typer.BadParameter(f"{text.strip()}: is not allowed; {problem}")
    return text.strip()


def _celsius(allowed: range) -> Callable[[str], int]:
    def read(text: str) -> int:
        if not text.strip().isdecimal() or int(text) not in allowed:
            steps = f" in steps of {allowed.step}" if allowed.step > 1 else ""
            raise typer.BadParameter(f"must be whole °C, {allowed[0]} to {allowed[-1]}{steps}")
        return int(text)

    return read
