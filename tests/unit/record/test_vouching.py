"""The line that names a run's last report: `report.written`."""

from __future__ import annotations

import json
from pathlib import Path

from jbclog.record.annotations import NAME, read, vouch
from jbclog.record.manifest import Manifest, manifest_sha256, write_manifest

HASHES = ("a" * 64, "b" * 64)


def test_a_report_is_named_by_a_line_that_is_no_annotation(tmp_path: Path) -> None:
    write_manifest(tmp_path, Manifest("a-run", state="sealed"))
    for report in (HASHES[0], HASHES[0], HASHES[1]):
        vouch(tmp_path, report)
    lines = [json.loads(line) for line in (tmp_path / NAME).read_text().splitlines()]
    kinds = [line["kind"] for line in lines]
    assert kinds == ["report.written", "report.written"]  # the same one is not named again
    annotations = read(tmp_path)
    assert (annotations.said, annotations.wrong) == ([], [])
    assert annotations.report == HASHES[1]
    assert annotations.head == manifest_sha256(tmp_path)
