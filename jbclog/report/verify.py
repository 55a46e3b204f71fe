"""Makes a run's report and verdict again, and compares them with those in its folder; writes
nothing.

A report of the same maker (versions of jbclog and its rules, typesetter, drawing library) has the
same bytes. For a report that names another maker, everything that does not depend on it is
compared. The rest is not known, and not known is not a pass: a report can claim any maker.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from jbclog.analysis.rejudge import check_verdict
from jbclog.analysis.run import open_run
from jbclog.analysis.verdict import RULES
from jbclog.core.files import Kind, read_regular
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read as read_annotations
from jbclog.record.check import changed_files
from jbclog.record.cross_check import report_disagreements
from jbclog.record.folder import expect_no_links
from jbclog.record.manifest import Manifest, manifest_sha256
from jbclog.report.agreement import CLAIMED, report_in
from jbclog.report.maker import Maker, impossible, maker_of, newer, tools
from jbclog.report.text import row_views
from jbclog.report.write import DATA, PAGE, PAPER, report_files

MOST: Final = 20  # metrics listed


@dataclass(frozen=True, slots=True)
class Verified:
    """Differences; what was not compared, so that it is not known whether it differs; notes on the
    verdict; a sentence each.
    """

    differing: list[str] = field(default_factory=list)
    not_compared: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def agrees(self) -> bool | None:
        """Whether everything agrees; None: not known."""
        if self.differing:
            return False
        return None if self.not_compared else True


def verified(folder: Path | str) -> Verified:
    """Make the report and the verdict again and compare them; compare recipes, line file and
    annotations with manifest and chain.
    """
    folder = Path(folder)
    expect_no_links(folder)
    manifest = open_run(folder).manifest
    files, not_compared = _of_files(folder, manifest)
    verdict = check_verdict(folder, manifest)
    differing = [*_annotated_since(folder), *files, *_changed(folder, manifest), *verdict.differing]
    return Verified(differing, not_compared, verdict.notes)


def _of_files(folder: Path, manifest: Manifest) -> tuple[list[str], list[str]]:
    """Return which files of the report differ, and which cannot be compared."""
    made = report_files(folder)
    differing = {
        name: text
        for name, content in made.items()
        if (text := _difference(folder / name, content))
    }
    there = report_in(folder)
    maker = None if there is None else maker_of(there)
    if not differing or there is None or maker is None or maker.is_this:
        return [*differing.values()], []
    here: dict[str, Any] = json.loads(made[DATA])
    left = _depend_on(maker, differing)
    found = [text for name, text in differing.items() if name not in left]
    disagree = report_disagreements(folder, manifest, read_annotations(folder))
    found += [
        f"{folder}/{name}: {text}"
        for name, text in disagree
        if name == DATA or name in left or name not in differing
    ]
    found += [
        f"{folder / DATA}: {text}"
        for text in [*impossible(maker), *_differences(maker, there, here)]
    ]
    return found, [f"{folder}: {_named(left)}: {_why(maker, folder)}"]


def _named(files: list[str]) -> str:
    """Return the first files by name, and the number of the others."""
    first = sorted(files, key=(PAGE, PAPER, DATA, *files).index)[:3]
    more = len(files) - len(first)
    return ", ".join(first) + (f" and {more} more file{'s' * (more > 1)}" if more else "")


def _why(maker: Maker, folder: Path) -> str:
    later = "".join(f", {text}" for text in newer(maker))
    return (
        f"made by {maker}{later}, not compared byte for byte; run `jbclog report {folder}` to make"
        " it again"
    )


def _depend_on(maker: Maker, differing: Mapping[str, str]) -> list[str]:
    """Return the differing files whose bytes may depend on the maker."""
    if not maker.has_these_words:
        return [*differing]
    if maker.tools["drawn_by"] != tools()["drawn_by"]:
        return [
            name
            for name in differing
            if not name.startswith("tables/") and not name.endswith(".parquet")
        ]
    return [name for name in differing if name in (PAPER, DATA)]


def _differences(maker: Maker, there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    """Yield what differs in `report.json` although its maker uses the same rules and methods."""
    if maker.has_these_words:
        keys = [
            key
            for key in {**here, **there}
            if key not in CLAIMED and here.get(key) != there.get(key)
        ]
        yield from (f"{key}: differs from what this record gives" for key in keys[:MOST])
    elif maker.rules == RULES:
        yield from _metrics(there.get("metrics"), here["metrics"])


def _metrics(there: object, here: list[dict[str, object]]) -> Iterator[str]:
    """Yield the metrics whose value differs; a later version may have more of them, never other
    values by the same methods.
    """
    known = {_place(row): row.get("value") for row in row_views(there)}
    if here and not known:
        yield f"metrics: there are none, the record gives {len(here)}"
        return
    wrong = [row for row in here if known.get(_place(row), row.get("value")) != row.get("value")]
    for row in wrong[:MOST]:
        name, station, port = row.get("metric"), row.get("station"), row.get("port")
        yield (
            f"metrics, {name} of {station} port {port}: {known[_place(row)]!s:.40}, the record"
            f" gives {row.get('value')}"
        )


def _place(row: Mapping[str, object]) -> tuple[str, ...]:
    return tuple(str(row.get(key)) for key in ("station", "port", "metric"))


def _changed(folder: Path, manifest: Manifest) -> list[str]:
    """Return the sealed files and the annotations that were changed."""
    sealed = [f"{folder / one.file}: {one.text}" for one in changed_files(folder, manifest)]
    return [*sealed, *(f"{folder}/{text}" for text in read_annotations(folder).complaints())]


def _annotated_since(folder: Path) -> list[str]:
    """Return why the whole report differs, if annotations are newer than it."""
    report = report_in(folder)
    if (
        report is None
        or "annotations_head" not in report
        or report.get("manifest_sha256") != manifest_sha256(folder)
    ):
        return []
    if report["annotations_head"] == read_annotations(folder).head:
        return []
    return [
        f"{folder / ANNOTATIONS}: annotations are newer than this report; run `jbclog report"
        f" {folder}` to include them"
    ]


def _difference(path: Path, content: bytes) -> str | None:
    try:
        same = read_regular(path, Kind.OF_REPORT) == content
    except OSError as error:
        return f"{path}: {error.strerror}"
    return None if same else f"{path}: differs from the report that this record gives"
