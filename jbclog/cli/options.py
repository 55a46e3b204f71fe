"""Options shared by several commands, and their conversion to values."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import typer

from jbclog.cli.names import complete_station
from jbclog.core.errors import Problem, Problems, RecordError, UsageError, problems_of

if TYPE_CHECKING:
    from jbclog.app.port_access import PortAccess
    from jbclog.app.run.options import Metadata, RunOptions

T = TypeVar("T")


def port_access(ctx: typer.Context) -> PortAccess:
    """Return the port access that the caller set as the context's `obj`, else the system's."""
    from jbclog.app.port_access import SYSTEM, PortAccess

    return ctx.find_object(PortAccess) or SYSTEM


# -- paths -----------------------------------------------------------------------------------------

PICTURES = (".png", ".svg", ".pdf")
NO_FOLDER = "{}: no such folder; runs are in `runs/` or in the folder given by --out"


def is_folder(path: Path) -> bool:
    """Return whether `path` is a folder. Raises `FileNotFoundError` if the current folder was
    removed.
    """
    whole = path.absolute()
    try:
        return whole.is_dir()
    except OSError:
        return False


def is_runs(path: Path) -> bool:
    """Return whether `path` is a folder, or a table of published runs."""
    from jbclog.record.published import is_table  # not imported by --help

    return is_table(path) or is_folder(path)


def expect_file_place(option: str, path: Path | None) -> None:
    """Raise `UsageError` if `path` exists and is not a regular file: writing to a pipe could
    block.
    """
    if path is not None and path.exists() and not path.is_file():
        raise UsageError(f"{option} {path}: not a regular file (folder, pipe or device)")


def expect_chart_place(plot: Path | None) -> None:
    """Raise `UsageError` if --plot is not the name of a picture, or cannot be written."""
    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise UsageError(f"--plot {plot}: must end in {', '.join(PICTURES)}")
    expect_file_place("--plot", plot)


def expect_run(folder: Path) -> None:
    """Raise `UsageError` if `folder` is not a run, `RecordError` if the run was cut off before its
    manifest was written.
    """
    from jbclog.record.manifest import NAME
    from jbclog.record.recover import is_run

    if not is_folder(folder):
        raise UsageError(NO_FOLDER.format(folder))
    if not is_run(Path(os.path.realpath(folder))):
        raise UsageError(
            f"{folder}: not a run; runs are in `runs/` or in the folder given by --out"
        )
    if not (folder / NAME).exists():
        raise RecordError(
            f"{folder}: no manifest, the run was cut off at its start; finish it with `jbclog"
            f" recover {folder}`"
        )


def expect_run_or_published(path: Path) -> None:
    """As `expect_run`; ``TABLE/RUN`` is accepted, too."""
    from jbclog.record.published import is_published  # not imported by --help

    if not is_published(path):
        expect_run(path)


# -- options ---------------------------------------------------------------------------------------

LINE = typer.Option(
    ...,
    "--line",
    "-l",
    metavar="FILE",
    help="Line file: stations and their ports.",
    show_default=False,
)
RECIPE = typer.Argument(
    None,
    metavar="RECIPE",
    help="Recipe file; optional if every station names its own.",
    show_default=False,
)
STATION = typer.Option([], "--station", "-s", metavar="NAME", help="Only this station; repeatable.")
RATE = typer.Option(
    None,
    "--rate",
    metavar="HZ|auto|fit|max",
    help=(
        "Sampling rate, Hz; auto leaves a fifth of the link free, fit uses it all, max never"
        " pauses. Default: the recipe's."
    ),
)
ALLOW_OMEGA_WRITE = typer.Option(
    False, "--allow-omega-write", help="Allow writing the recipe's [omega] condition if it differs."
)
DURATION = typer.Option(
    None,
    "--duration",
    "-d",
    metavar="TIME",
    help="Recording time: 90s, 15m, 8h, 1h30m. Default: until Ctrl-C.",
)
UNTIL_UNITS = typer.Option(
    None,
    "--until-units",
    min=1,
    max=1_000_000,
    metavar="N",
    help="End after N units (--units); the next serial, or END, finishes a unit.",
    show_default=False,
)
UNTIL_JOINTS = typer.Option(
    None,
    "--until-joints",
    min=1,
    max=1_000_000,
    metavar="N",
    help="End after N joints, all stations together.",
    show_default=False,
)
RUNS = typer.Argument(Path("runs"), metavar="DIR", help="Folder of runs.")
RUNS_OR_TABLE = typer.Argument(
    Path("runs"), metavar="DIR|TABLE", help="Folder of runs, or published runs."
)
OUT = typer.Option(Path("runs"), "--out", "-o", metavar="DIR", help="Folder of runs.")
RUN = typer.Argument(..., metavar="RUN", help="Run folder.", show_default=False)
RUN_OR_PUBLISHED = typer.Argument(
    ..., metavar="RUN", help="Run folder, or TABLE/RUN.", show_default=False
)
STATION_NAMED = typer.Argument(
    ...,
    metavar="STATION",
    help="Station name.",
    show_default=False,
    autocompletion=complete_station,
)
STATION_OR_ALL = typer.Option(
    None, "--station", "-s", metavar="NAME", help="Station; default: all.", show_default=False
)
PORT = typer.Option(
    None,
    "--port",
    "-p",
    min=1,
    max=4,
    metavar="N",
    help="Port number; default: all.",
    show_default=False,
)
TOOL = typer.Option(
    None,
    "--tool",
    "-t",
    min=0,
    max=9,
    metavar="N",
    help="Tool code; default: the connected tool.",
    show_default=False,
)
CONDITION = typer.Option(
    None,
    "--condition",
    min=0,
    max=399,
    metavar="N",
    help="Solder condition (OMEGA).",
    show_default=False,
)


class Color(StrEnum):
    """When to use colours; ``auto``: on a terminal, unless NO_COLOR is set."""

    AUTO = "auto"
    ALWAYS = "always"
    NEVER = "never"


COLOR = typer.Option(
    Color.AUTO, "--color", metavar="auto|always|never", help="Colour events by severity."
)
NO_CACHE = typer.Option(
    False, "--no-cache", help="Compute every metric anew from the samples, without caches."
)
AS_JSON = typer.Option(False, "--json", help="Print one JSON object.")
JSON_PER_RUN = typer.Option(False, "--json", help="Print one JSON object per run.")
LOWER = typer.Option(None, metavar="VALUE", help="Lower specification limit.", show_default=False)
UPPER = typer.Option(None, metavar="VALUE", help="Upper specification limit.", show_default=False)
PLOT = typer.Option(None, "--plot", metavar="FILE", help="Chart file: .png, .svg or .pdf.")
TCP = typer.Option(None, metavar="HOST:PORT", help="First TCP port; one port per station.")
REMARK = typer.Option("", "--note", metavar="TEXT", help="Note.")
# conditions on runs
ORDER = typer.Option(None, metavar="NUMBER", help="Work order.")
PRODUCT = typer.Option(None, metavar="NAME", help="Product.")
RECIPE_NAME = typer.Option(None, metavar="NAME[@REVISION]", help="Recipe name.")
LINE_NAME = typer.Option(None, metavar="NAME", help="Line name.")
UNTIL = typer.Option(None, metavar="TIME", help="Latest start, UTC; a day is included.")

LONGEST_TEXT = 200
SEVERAL = ("--unit", "--wire-lot", "--flux-lot", "--tip")  # may be repeated
HIDDEN = ("Cc", "Cf", "Co", "Cn", "Zl", "Zp")  # Unicode categories of invisible characters


class Mistakes:
    """Collects the mistakes of a command line, to be reported with those of the files."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def read(self, option: Callable[[], T], otherwise: T) -> T:
        """Return the value of an option; `otherwise` if it is wrong."""
        try:
            return option()
        except UsageError as error:
            self.problems += problems_of(error)
            return otherwise


def duration_s(text: str | None) -> float | None:
    """Return the seconds of ``90s``, ``15m``, ``8h`` or ``1h30m``. Raises `UsageError`."""
    if text is None:
        return None
    from jbclog.config.durations import EXAMPLES, span_s

    seconds = span_s(text)
    if seconds is not None and not text.strip().endswith(("s", "m", "h")):
        raise UsageError(f"--duration {text}: give the unit: {text}s, {text}m or {text}h")
    if seconds is None:
        raise UsageError(f"--duration {text}: give {EXAMPLES}")
    return seconds


def rate(text: str | None) -> float | str | None:
    """Return the rate in Hz, or ``auto``, ``fit`` or ``max``. Raises `UsageError`."""
    if text is None or text in ("auto", "fit", "max"):
        return text
    try:
        hertz = float(text)
    except ValueError:
        hertz = 0.0
    if not 0 < hertz <= 1000:
        raise UsageError(f"--rate {text}: must be auto, fit, max or a number of Hz up to 1000")
    return hertz


def tags(pairs: Sequence[str]) -> dict[str, str]:
    """Return the ``NAME=VALUE`` pairs as a dict. Raises `UsageError`."""
    found: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise UsageError(f"--tag {pair}: must be NAME=VALUE")
        if key in found:
            raise UsageError(f"--tag {pair}: {key} is given twice")
        found[key] = value
    return found


def metadata(
    operator: str | None,
    order: str | None,
    product: str | None,
    several: Mapping[str, Sequence[str]],
) -> Metadata:
    """Return a run's metadata; `several`: values of repeatable options. Raises `Problems` with all
    mistakes.
    """
    from jbclog.app.run.options import Metadata

    mistakes = Mistakes()
    texts = [("--operator", operator), ("--order", order), ("--product", product)]
    texts += [(option, text) for option, those in several.items() for text in those]
    for option, text in texts:
        mistakes.read(partial(check_text, option, text or ""), None)
    no_tags: dict[str, str] = {}
    tagged = mistakes.read(lambda: tags(several.get("--tag", ())), no_tags)
    if mistakes.problems:
        raise Problems(mistakes.problems)
    units, wire_lots, flux_lots, tips = (tuple(several.get(option, ())) for option in SEVERAL)
    return Metadata(operator, order, product, units, tagged, wire_lots, flux_lots, tips)


def signed(what: str, by: str | None, reason: str | None) -> tuple[str, str]:
    """Return author and reason of a permanent entry.

    Raises `UsageError` with everything that is missing or has hidden characters.
    """
    given = {"--by WHO": by or "", "--reason TEXT": reason or ""}
    missing = [option for option, text in given.items() if not text.strip()]
    if missing:
        raise UsageError(
            f"{what}: {' and '.join(missing)} {'are' if len(missing) > 1 else 'is'} required;"
            " nothing was added"
        )
    for option, text in given.items():
        check_text(option.partition(" ")[0], text)
    return by or "", reason or ""


def check_text(option: str, text: str) -> None:
    """Raise `UsageError` if `text` is too long or has hidden characters."""
    if len(text) > LONGEST_TEXT:
        raise UsageError(f"{option}: {len(text)} characters, at most {LONGEST_TEXT}")
    for sign in text:
        category = unicodedata.category(sign)
        if category == "Cs":  # a surrogate: bytes that could not be decoded
            raise UsageError(f"{option}: bytes that are not text in this system's encoding")
        if category in HIDDEN:
            raise UsageError(f"{option}: hidden or control character U+{ord(sign):04X}")


def wanted(
    line: Path,
    recipe: Path | None,
    stations: list[str],
    duration: str | None,
    rate_text: str | None,
    metadata: Metadata | None = None,
    *,
    allow_omega_write: bool = False,
    mistakes: Mistakes | None = None,
) -> RunOptions:
    """Return the options of a run, with the `mistakes` of the command line."""
    from jbclog.app.run.options import RunOptions

    mistakes = mistakes or Mistakes()
    seconds = mistakes.read(lambda: duration_s(duration), None)
    rate_hz = mistakes.read(lambda: rate(rate_text), None)
    return RunOptions(
        line,
        recipe,
        tuple(stations),
        seconds,
        rate_hz,
        metadata,
        allow_omega_write=allow_omega_write,
        mistakes=tuple(mistakes.problems),
    )
