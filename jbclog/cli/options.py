"""Options that several verbs share, and how their texts become values."""

from __future__ import annotations

import os
import unicodedata
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from jbclog.cli.names import complete_station
from jbclog.core.errors import RecordError, UsageError

if TYPE_CHECKING:
    from jbclog.app.run.plan import Metadata, RunOptions

# -- run folder ---------------------------------------------------------------------------------------------------------------
# Whether a folder that was named is a run's, and a file that was named one that can be written.


def is_folder(path: Path) -> bool:
    """Whether there is a folder; a name that no file can have is none. Raises `RecordError` where its network mount hangs."""
    from jbclog.core.foreign.files import expect_answer  # here, so that help does not load it

    expect_answer(path)
    try:
        return path.is_dir()
    except OSError:
        return False


def expect_file_place(option: str, path: Path | None) -> None:
    """Raise `UsageError` where something stands at `path` that is no file: a pipe waits for who reads it, maybe for ever."""
    if path is not None and path.exists() and not path.is_file():
        raise UsageError(f"{option} {path}: that is a folder, a pipe or a device, and no file to be written anew")


def expect_run(folder: Path) -> None:
    """Raise `UsageError` where `folder` is no run's, `RecordError` where a run was cut off before it had a manifest."""
    from jbclog.record.manifest import NAME
    from jbclog.record.recover import is_run

    if not is_folder(folder):
        raise UsageError(f"{folder}: there is no such folder; runs are in `runs/`, or where --out put them")
    if not is_run(Path(os.path.realpath(folder))):
        raise UsageError(f"{folder} is no run's folder; runs are in `runs/`, or where --out put them")
    if not (folder / NAME).exists():
        raise RecordError(f"{folder} has no manifest: it was cut off at its very start; `jbclog recover {folder}` finishes it")


# -- options ------------------------------------------------------------------------------------------------------------------

LINE = typer.Option(..., "--line", "-l", metavar="FILE", help="The line file: which stations, on which ports.", show_default=False)
RECIPE = typer.Argument(
    None, metavar="RECIPE", help="The recipe file. Not needed where each station of the line names its own.", show_default=False
)
STATION = typer.Option([], "--station", "-s", metavar="NAME", help="Only this station of the line; may be repeated.")
RATE = typer.Option(
    None,
    "--rate",
    metavar="HZ|auto|fit|max",
    help="Ticks a second. auto: the highest usual rate that leaves a fifth of the link free; fit: the highest that fits; "
    "max: without pause. Default: the recipe's.",
)
ALLOW_OMEGA_WRITE = typer.Option(
    False, "--allow-omega-write", help="Let the recipe's [omega] condition be written where the controller holds another."
)
DURATION = typer.Option(
    None, "--duration", "-d", metavar="TIME", help="How long to record: 90s, 15m, 8h, 1h30m. Default: until Ctrl-C."
)
UNTIL_UNITS = typer.Option(
    None,
    "--until-units",
    min=1,
    max=1_000_000,
    metavar="N",
    help="End when N units are finished: when another serial, or the word END, was read after each (--units).",
    show_default=False,
)
UNTIL_JOINTS = typer.Option(
    None,
    "--until-joints",
    min=1,
    max=1_000_000,
    metavar="N",
    help="End when N joints are found, of all stations together; some seconds after the last.",
    show_default=False,
)
OUT = typer.Option(Path("runs"), "--out", "-o", metavar="DIR", help="The folder that the run's folder is made in.")
RUN = typer.Argument(..., metavar="RUN", help="A run's folder.", show_default=False)
STATION_NAMED = typer.Argument(
    ..., metavar="STATION", help="A station of the line, by name.", show_default=False, autocompletion=complete_station
)
PORT = typer.Option(None, "--port", "-p", min=1, max=4, metavar="N", help="Which port of the station.", show_default=False)
TOOL = typer.Option(
    None, "--tool", "-t", min=0, max=9, metavar="N", help="Which tool, by its code. Default: the one connected.", show_default=False
)
CONDITION = typer.Option(
    None, "--condition", min=0, max=399, metavar="N", help="Which solder condition (omega).", show_default=False
)
AS_JSON = typer.Option(False, "--json", help="One JSON object on stdout.")

LONGEST_TEXT = 200
SEVERAL = ("--unit", "--wire-lot", "--flux-lot", "--tip")  # may be repeated
HIDDEN = ("Cc", "Cf", "Co", "Cn", "Zl", "Zp")  # categories of characters that do not show


def duration_s(text: str | None) -> float | None:
    """Seconds in ``90s``, ``15m``, ``8h``, ``1h30m`` or a bare number. Raises `UsageError`."""
    if text is None:
        return None
    from jbclog.config.durations import EXAMPLES, span_s

    seconds = span_s(text)
    if seconds is None:
        raise UsageError(f"--duration {text}: give {EXAMPLES}")
    return seconds


def rate(text: str | None) -> float | str | None:
    """The rate in Hz, ``auto``, ``fit`` or ``max``. Raises `UsageError`."""
    if text is None or text in ("auto", "fit", "max"):
        return text
    try:
        hertz = float(text)
    except ValueError:
        hertz = 0.0
    if not 0 < hertz <= 1000:
        raise UsageError(f"--rate {text}: give a number of Hz up to 1000, `auto`, `fit` or `max`")
    return hertz


def tags(pairs: Sequence[str]) -> dict[str, str]:
    """``K=V`` pairs. Raises `UsageError`."""
    found: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise UsageError(f"--tag {pair}: give it as NAME=VALUE")
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
    """What people say of a run; `several` by the options that may be repeated.

    Raises `UsageError` where a text could not be kept, shown or signed as it is.
    """
    from jbclog.app.run.plan import Metadata

    told = [("--operator", operator), ("--order", order), ("--product", product)]
    told += [(option, text) for option, texts in several.items() for text in texts]
    for option, text in told:
        check_text(option, text or "")
    units, wire_lots, flux_lots, tips = (tuple(several.get(option, ())) for option in SEVERAL)
    return Metadata(operator, order, product, units, tags(several.get("--tag", ())), wire_lots, flux_lots, tips)


def check_text(option: str, text: str) -> None:
    """Raise `UsageError` where a text could not be kept, shown or signed as it is."""
    if len(text) > LONGEST_TEXT:
        raise UsageError(f"{option}: {len(text)} characters; at most {LONGEST_TEXT} are kept")
    for sign in text:
        category = unicodedata.category(sign)
        if category == "Cs":  # what the shell gave could not be decoded
            raise UsageError(f"{option}: holds bytes that are no text in this system's encoding")
        if category in HIDDEN:
            raise UsageError(f"{option}: holds the hidden or control character U+{ord(sign):04X}")


def wanted(
    line: Path,
    recipe: Path | None,
    stations: list[str],
    duration: str | None,
    rate_text: str | None,
    metadata: Metadata | None = None,
    *,
    allow_omega_write: bool = False,
) -> RunOptions:
    """What the options ask for."""
    from jbclog.app.run.plan import RunOptions

    return RunOptions(
        line,
        recipe,
        tuple(stations),
        duration_s(duration),
        rate(rate_text),
        metadata,
        allow_omega_write=allow_omega_write,
    )
