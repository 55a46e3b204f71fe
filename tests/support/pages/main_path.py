"""docs/pictures/main-path.svg: the seven files of the main path and the way back, and how they
import each other.
"""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import NamedTuple

import grimp

from support.pages.md_table import MADE

DOWN = (
    ("app.run.plan", "line file and recipe become a plan"),
    ("app.run.recorder", "all stations of a run, first to last"),
    ("transport.reactor", "pulls sessions, moves bytes"),
    ("session.run.station_run", "one station, first question to safe state"),
    ("protocol.client.robot", "asks, and decides what to believe"),
    ("protocol.commands.robot", "every command, with its manual section"),
    ("protocol.frame", "frames, and their bytes"),
)
BACK = (
    ("report.write", "page, PDF, tables"),
    ("analysis.run", "DataFrames of a run"),
    ("record.seal", "Parquet, hourly and at the end"),
    ("record.run_journal", "segments of frames, a commit every 0.6 s"),
)
CHAINS = (
    ("app.run.recorder", "protocol.client.robot"),
    ("app.run.recorder", "record.run_journal"),
    ("protocol.client.robot", "protocol.frame"),
)
"""Pairs that others stand between."""
WIDTH, HEIGHT, BOX, TALL, STEP, TOP = 760, 560, 270, 48, 76, 24
LEFT, RIGHT = 70, 460
STYLE = (
    "text{font:13px"
    " sans-serif;fill:#222}.q{font-size:11px;fill:#555}rect{fill:#fff;stroke:#3b6ea5;stroke-width:1.5}path{fill:none;stroke:#555;stroke-width:1.3;marker-end:url(#a)}.v{stroke-dasharray:5"
    " 4}.d{stroke:#a5673b;stroke-dasharray:2 3}"
)


class Box(NamedTuple):
    """One file on the picture."""

    x: int
    y: int
    text: str


BOXES = {name: Box(LEFT, TOP + STEP * row, text) for row, (name, text) in enumerate(DOWN)}
BOXES |= {name: Box(RIGHT, TOP + STEP * row, text) for row, (name, text) in enumerate(BACK)}


def files() -> list[Path]:
    """The seven files, from the repository's root."""
    return [Path("jbclog", *name.split(".")).with_suffix(".py") for name, _ in DOWN]


def svg() -> str:
    """The picture: solid for an import, dashed through the files that are named, dotted where files
    on disk are read or a process is started.
    """
    graph = grimp.build_graph("jbclog", cache_dir=None)
    lines = [_box(name, box) for name, box in BOXES.items()]
    for importer in BOXES:
        imported = graph.find_modules_directly_imported_by(f"jbclog.{importer}")
        lines += [_arrow(importer, other) for other in BOXES if f"jbclog.{other}" in imported]
    for importer, other in CHAINS:
        chain = _shortest_chain(graph, f"jbclog.{importer}", f"jbclog.{other}")
        between = ", ".join(
            f"{name.removeprefix('jbclog.').replace('.', '/')}.py" for name in chain[1:-1]
        )
        lines.append(_arrow(importer, other, "v", f"through {between}"))
    lines.append(_arrow("analysis.run", "record.seal", "d", "reads the files that it left"))
    lines.append(_arrow("record.run_journal", "record.seal", "d", "starts it as a process"))
    drawn = "\n".join(lines)
    return (
        f'{MADE}\n<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}"'
        f' role="img"><title>The main path</title><style>{STYLE}</style><defs><marker id="a"'
        ' viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto"><path'
        ' d="M0 0L8 4L0 8z"'
        f' style="fill:#555;stroke:none;marker-end:none"/></marker></defs>\n{drawn}\n</svg>\n'
    )


def _shortest_chain(graph: grimp.ImportGraph, importer: str, imported: str) -> list[str]:
    """Return the first by name of the shortest ways from one module to another; the library's own
    is any of them.
    """
    chains = [[importer]]
    seen = {importer}
    for chain in chains:
        for name in sorted(graph.find_modules_directly_imported_by(chain[-1]) - seen):
            if name == imported:
                return [*chain, name]
            seen.add(name)
            chains.append([*chain, name])
    return []


def _box(name: str, box: Box) -> str:
    path = f"{name.replace('.', '/')}.py"
    return (
        f'<rect x="{box.x}" y="{box.y}" width="{BOX}" height="{TALL}" rx="5"/>'
        f'<text x="{box.x + 12}" y="{box.y + 20}">{path}</text>'
        f'<text class="q" x="{box.x + 12}" y="{box.y + 37}">{escape(box.text)}</text>'
    )


def _arrow(importer: str, imported: str, kind: str = "i", note: str = "") -> str:
    one, other = BOXES[importer], BOXES[imported]
    if one.x != other.x:
        path = f"M{one.x + BOX} {one.y + TALL // 2}L{other.x} {other.y + TALL // 2}"
        at = (one.x + BOX + 45, one.y + TALL + 18)  # beside the line
    elif abs(one.y - other.y) == STEP:
        down = other.y > one.y
        middle, begin, end = one.x + BOX // 2, one.y + TALL * down, other.y + TALL * (not down)
        path, at = f"M{middle} {begin}L{middle} {end}", (middle + 10, (begin + end) // 2 + 4)
    else:
        begin, end = one.y + TALL // 2, other.y + TALL // 2
        out = one.x - 22 * abs(one.y - other.y) // STEP
        path = f"M{one.x} {begin}C{out} {begin} {out} {end} {other.x} {end}"
        at = (one.x + 6, other.y - 9)
    text = f'<text class="q" x="{at[0]}" y="{at[1]}">{escape(note)}</text>' if note else ""
    return f'<path class="{kind}" d="{path}"/>{text}'
