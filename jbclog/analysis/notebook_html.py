"""Runs as notebooks show them: small HTML tables, every text that comes from outside escaped."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Final

from jbclog.record.find_runs import Found, Unreadable, ending
from jbclog.record.manifest import Manifest

MOST_RUNS: Final = 20
LONGEST: Final = 80
HEADS: Final = ("started", "line", "recipes", "operator", "order", "product", "units", "verdict", "state", "run")


def run_html(name: str, manifest: Manifest) -> str:
    """A run: its verdict, what was said of it, its stations."""
    said = manifest.metadata
    facts = [
        ("verdict", manifest.verdict or "none yet"),
        ("state", ending(manifest.exit_status, manifest.state)),
        ("from", shortened(manifest.started)),
        ("to", shortened(manifest.ended)),
        ("line", manifest.line.name if manifest.line else None),
        ("recipes", ", ".join(f"{one.name}@{one.revision}" for one in manifest.recipes)),
        ("operator", said.operator),
        ("order", said.order),
        ("product", said.product),
        ("units", _several(manifest.serials())),
    ]
    stations = [(one.name, one.model, ", ".join(map(str, one.ports)), one.outcome) for one in manifest.stations]
    rows = "".join(f"<tr><th>{text(name)}</th><td>{text(value)}</td></tr>" for name, value in facts if value)
    below = table(("station", "model", "ports", "outcome"), stations) if stations else ""
    return f"<div><b>{text(name)}</b><table>{rows}</table>{below}</div>"


def runs_html(folder: Path, found: Sequence[Found], unreadable: Sequence[Unreadable]) -> str:
    """Runs: a row for each of the first, and how many there are."""
    rows = [_row(one) for one in found[:MOST_RUNS]]
    more = f"<p>and {len(found) - MOST_RUNS} more</p>" if len(found) > MOST_RUNS else ""
    unread = f"<p>{len(unreadable)} folders cannot be read (.unreadable)</p>" if unreadable else ""
    count = f"{len(found)} run{'' if len(found) == 1 else 's'} in {folder}"
    return f"<div><b>{text(count)}</b>{table(HEADS, rows) if rows else ''}{more}{unread}</div>"


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table of texts."""
    head = "".join(f"<th>{text(name)}</th>" for name in heads)
    body = "".join(f"<tr>{''.join(f'<td>{text(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def text(value: object) -> str:
    """A value as text that can do nothing: escaped, without what does not show, not too long."""
    told = "" if value is None else str(value)
    shown = "".join(sign if sign.isprintable() else "�" for sign in told[: LONGEST + 1])
    return escape(shown if len(told) <= LONGEST else shown[: LONGEST - 1] + "…")


def shortened(time: str | None) -> str | None:
    """A manifest's time to the second."""
    return None if time is None else time[:19].replace("T", " ") + " UTC"


def _row(one: Found) -> tuple[object, ...]:
    who = (one.operator, one.order, one.product, _several(one.units))
    return (
        shortened(one.started),
        one.line,
        ", ".join(one.recipes),
        *who,
        one.verdict,
        one.shown_state,
        one.folder.name,
    )


def _several(texts: Sequence[str]) -> str:
    return f"{texts[0]} +{len(texts) - 1}" if len(texts) > 1 else "".join(texts)
