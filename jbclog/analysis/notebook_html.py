"""Small HTML tables that show runs in a notebook; foreign text is escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

from jbclog.core.text import count_text
from jbclog.record.find_runs import Copy, Found, Unreadable, ending
from jbclog.record.manifest import Manifest

MOST_RUNS: Final = 20
MOST_CHARACTERS: Final = 80  # characters of a cell
HEADS: Final = (
    "start",
    "line",
    "recipes",
    "operator",
    "order",
    "product",
    "units",
    "verdict",
    "state",
    "run",
)


def run_html(name: str, manifest: Manifest) -> str:
    """Return a run's verdict, metadata and stations."""
    metadata = manifest.metadata
    facts = [
        ("verdict", manifest.verdict or "none yet"),
        ("state", ending(manifest.exit_status, manifest.state)),
        ("from", shortened(manifest.start)),
        ("to", shortened(manifest.stop)),
        ("line", manifest.line.name if manifest.line else None),
        ("recipes", ", ".join(f"{one.name}@{one.revision}" for one in manifest.recipes)),
        ("operator", metadata.operator),
        ("order", metadata.order),
        ("product", metadata.product),
        ("units", _several(manifest.serials())),
    ]
    stations = [
        (one.name, one.model, ", ".join(map(str, one.ports)), one.outcome)
        for one in manifest.stations
    ]
    rows = "".join(
        f"<tr><th>{text(fact)}</th><td>{text(value)}</td></tr>" for fact, value in facts if value
    )
    below = table(("station", "model", "ports", "outcome"), stations) if stations else ""
    return f"<div><b>{text(name)}</b><table>{rows}</table>{below}</div>"


def runs_html(
    folder: Path, found: Sequence[Found], copies: Sequence[Copy], unreadable: Sequence[Unreadable]
) -> str:
    """Return a row for each of the first `MOST_RUNS` runs, and the total number."""
    rows = [_row(one) for one in found[:MOST_RUNS]]
    more = f"<p>and {len(found) - MOST_RUNS} more</p>" if len(found) > MOST_RUNS else ""
    if copies:
        more += f"<p>{count_text(len(copies), 'folder')} with a run of another one (.copies)</p>"
    failed = f"<p>{len(unreadable)} folders cannot be read (.unreadable)</p>" if unreadable else ""
    count = f"{count_text(len(found), 'run')} in {folder}"
    return f"<div><b>{text(count)}</b>{table(HEADS, rows) if rows else ''}{more}{failed}</div>"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table with these column heads and cells."""
    head = "".join(f"<th>{text(name)}</th>" for name in heads)
    body = "".join(f"<tr>{''.join(f'<td>{text(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def text(value: object) -> str:
    """Return a value as escaped text, cut to `MOST_CHARACTERS`, with `�` for unprintable
    characters.
    """
    raw = "" if value is None else str(value)
    printable = "".join(sign if sign.isprintable() else "�" for sign in raw[: MOST_CHARACTERS + 1])
    return escape(
        printable if len(raw) <= MOST_CHARACTERS else printable[: MOST_CHARACTERS - 1] + "…"
    )


def shortened(time: str | None) -> str | None:
    """Return a time of a manifest to the second: ``2026-11-21 01:30:00 UTC``."""
    return None if time is None else time[:19].replace("T", " ") + " UTC"


def _row(one: Found) -> tuple[object, ...]:
    what = (shortened(one.start), one.line, ", ".join(one.recipes))
    return (
        *what,
        one.operator,
        one.order,
        one.product,
        _several(one.units),
        one.verdict,
        one.shown_state,
        one.folder.name,
    )


def _several(texts: Sequence[str]) -> str:
    return f"{texts[0]} +{len(texts) - 1}" if len(texts) > 1 else "".join(texts)
