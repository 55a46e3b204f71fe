"""Make a run's report and verdict again, and compare them with those in its folder; write nothing.

A report of the same maker (version of jbclog and of its rules, typesetter, drawing library) has the same bytes. Of a report
that names another maker everything is compared that does not depend on it. What is left is not known, and not known is no pass: a
report can name any maker.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from jbclog import __version__
from jbclog.analysis.rejudge import check_verdict
from jbclog.analysis.run import open_run
from jbclog.analysis.verdict import RULES
from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import read_json
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import read as read_annotations
from jbclog.record.check import changed_files, report_disagreements
from jbclog.record.folder import expect_no_links
from jbclog.record.manifest import Manifest, manifest_sha256
from jbclog.report.write import DATA, PAGE, PAPER, report_files, tools

FIRST: Final = (0, 1, 0)
"""The first release: an earlier one made no report."""
_VERSION: Final = re.compile(r"(\d{1,6})\.(\d{1,6})\.(\d{1,6})([-.+a-z][-.+a-z0-9]{0,30})?")
OF_TOOLS: Final = ("paper_by", "drawn_by", "written")
MOST: Final = 20  # figures of metrics that are listed


@dataclass(frozen=True, slots=True)
class Verified:
    """What differs; what was not compared, so that it is not known whether it differs; notes on the verdict; a sentence each."""

    differing: list[str] = field(default_factory=list)
    not_compared: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def agrees(self) -> bool | None:
        """Whether everything agrees; None: not known."""
        if self.differing:
            return False
        return None if self.not_compared else True


@dataclass(frozen=True, slots=True)
class _Maker:
    """Who a report says that it was made by; `rules` is 1 for the first release, which named none."""

    version: object
    rules: object
    tools: Mapping[str, object]

    @property
    def is_this(self) -> bool:
        return (self.version, self.rules, dict(self.tools)) == (__version__, RULES, tools())

    def __str__(self) -> str:
        named = [f"{tool!s:.20}" for tool in self.tools.values() if tool is not None]
        return ", ".join([f"jbclog {self.version!s:.20} with rules {self.rules!s:.10}", *named])


def verify_report(folder: Path | str) -> list[str]:
    """Return what `verified` finds to differ or cannot compare, a sentence each; empty: all is compared and agrees."""
    found = verified(folder)
    return [*found.differing, *found.not_compared]


def verified(folder: Path | str) -> Verified:
    """Make the report and the verdict again and compare them; recipes, line file and annotations with manifest and chain."""
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
    differing = {name: text for name, content in made.items() if (text := _difference(folder / name, content))}
    there = _report(folder)
    maker = None if there is None else _maker(there)
    if not differing or there is None or maker is None or maker.is_this:
        return [*differing.values()], []
    here: dict[str, Any] = json.loads(made[DATA])
    left = _depend_on(maker, differing)
    found = [text for name, text in differing.items() if name not in left]
    disagree = report_disagreements(folder, manifest, read_annotations(folder))
    found += [f"{folder}/{name}: {text}" for name, text in disagree if name == DATA or name in left or name not in differing]
    found += [f"{folder / DATA}: {text}" for text in [*_impossible(maker), *_unlike(maker, there, here)]]
    return found, [f"{folder}: {_named(left)}: {_why(maker, folder)}"]


def _named(files: list[str]) -> str:
    """Return the first files by name, and the number of the others."""
    first = sorted(files, key=(PAGE, PAPER, DATA, *files).index)[:3]
    more = len(files) - len(first)
    return ", ".join(first) + (f" and {more} more file{'s' * (more > 1)}" if more else "")


def _why(maker: _Maker, folder: Path) -> str:
    newer = "".join(f", {text}" for text in _newer(maker))
    return f"made by {maker}{newer}, not compared byte for byte; run `jbclog report {folder}` to make it again"


def _depend_on(maker: _Maker, differing: Mapping[str, str]) -> list[str]:
    """Return the differing files whose bytes another maker can have made otherwise."""
    if (maker.version, maker.rules) != (__version__, RULES):
        return [*differing]
    if maker.tools["drawn_by"] != tools()["drawn_by"]:
        return [name for name in differing if not name.startswith("tables/") and not name.endswith(".parquet")]
    return [name for name in differing if name in (PAPER, DATA)]


def _impossible(maker: _Maker) -> Iterator[str]:
    """Yield why no jbclog was this maker."""
    version = _numbers(maker.version)
    if version is None:
        yield f"names jbclog {maker.version!s:.20} as its maker; that is no version"
    elif version < FIRST:
        yield f"names jbclog {maker.version} as its maker; there was none before {'.'.join(map(str, FIRST))}"
    if not isinstance(maker.rules, int) or isinstance(maker.rules, bool) or maker.rules < 1:
        yield f"names rules {maker.rules!s:.20}; there are none"
    elif version is not None and version < (_numbers(__version__) or FIRST) and maker.rules > RULES:
        yield f"names jbclog {maker.version} with rules {maker.rules}; this jbclog, {__version__}, knows rules 1 to {RULES}"


def _newer(maker: _Maker) -> Iterator[str]:
    """Yield in what the maker is later than this jbclog."""
    version, own = _numbers(maker.version), _numbers(__version__)
    if version is not None and own is not None and version > own:
        yield f"newer than this one, {__version__}"
    if isinstance(maker.rules, int) and maker.rules > RULES:
        yield f"whose rules are not known here (1 to {RULES} are)"


def _numbers(version: object) -> tuple[int, ...] | None:
    """Return the three numbers of a version; None where it is none."""
    found = _VERSION.fullmatch(version) if isinstance(version, str) else None
    return None if found is None else tuple(map(int, found.group(1, 2, 3)))


def _unlike(maker: _Maker, there: Mapping[str, Any], here: Mapping[str, Any]) -> Iterator[str]:
    """Yield what differs in `report.json` although its maker uses the same rules and methods."""
    if (maker.version, maker.rules) == (__version__, RULES):
        keys = [key for key in {**here, **there} if key not in OF_TOOLS and here.get(key) != there.get(key)]
        yield from (f"{key}: differs from what this record gives" for key in keys[:MOST])
    elif maker.rules == RULES:
        yield from _metrics(there.get("metrics"), here["metrics"])


def _metrics(there: object, here: list[dict[str, object]]) -> Iterator[str]:
    """Yield the metrics whose value differs; a later version may have more of them, never other values by the same methods."""
    rows = [row for row in there if isinstance(row, dict)] if isinstance(there, list) else []
    known = {_place(row): row.get("value") for row in rows}
    if here and not known:
        yield f"metrics: there are none, the record gives {len(here)}"
        return
    wrong = [row for row in here if known.get(_place(row), row.get("value")) != row.get("value")]
    for row in wrong[:MOST]:
        name, station, port = row.get("metric"), row.get("station"), row.get("port")
        yield f"metrics, {name} of {station} port {port}: {known[_place(row)]!s:.40}, the record gives {row.get('value')}"


def _place(row: Mapping[str, object]) -> tuple[str, ...]:
    return tuple(str(row.get(key)) for key in ("station", "port", "metric"))


def _report(folder: Path) -> dict[str, Any] | None:
    """Return `report.json`; None where it cannot be read as one."""
    try:
        found = read_json(folder / DATA, Kind.REPORT)
    except (OSError, ValueError, TypeError, RecursionError):
        return None
    return found if isinstance(found, dict) else None


def _maker(report: Mapping[str, Any]) -> _Maker | None:
    """Return who the report names as its maker; None if nobody."""
    if "jbclog" not in report:
        return None
    return _Maker(report["jbclog"], report.get("rules", 1), {key: report.get(key) for key in tools()})


def _changed(folder: Path, manifest: Manifest) -> list[str]:
    """Return the sealed files and the annotations that were changed."""
    sealed = [f"{folder / one.file}: {one.text}" for one in changed_files(folder, manifest)]
    return [*sealed, *(f"{folder}/{text}" for text in read_annotations(folder).complaints())]


def _annotated_since(folder: Path) -> list[str]:
    """Return why the whole report differs, where annotations are newer than it."""
    report = _report(folder)
    if report is None or "annotations_head" not in report or report.get("manifest_sha256") != manifest_sha256(folder):
        return []
    if report["annotations_head"] == read_annotations(folder).head:
        return []
    return [f"{folder / ANNOTATIONS}: annotations are newer than this report; run `jbclog report {folder}` to include them"]


def _difference(path: Path, content: bytes) -> str | None:
    try:
        same = read_foreign(path, Kind.OF_REPORT) == content
    except OSError as error:
        return f"{path}: {error.strerror}"
    return None if same else f"{path}: differs from the report that this record gives"
