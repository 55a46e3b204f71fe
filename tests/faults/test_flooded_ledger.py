"""Ledgers of nothing but faults: refused in one line, in little time and memory."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.core.errors import RecordError
from jbclog.maintenance.ledger import read_book
from support.measured import measured

OTHER = b'{"seq": 1, "kind": "counters", "line": "small", "station": "dde-1", "x": 1}\n'
FLOODS = {
    "line ends": (b"\n", 20_000_000, "is no line of a ledger"),
    "junk": (b"x" * 99 + b"\n", 500_000, "is no line of a ledger"),
    "JSON of another kind": (OTHER, 500_000, "is no line of a ledger"),
    "one line": (b"A", 60_000_000, "has more than 262144 bytes"),
    "nesting without a line end": (b"[", 30_000_000, "has more than 262144 bytes"),
}


@pytest.mark.parametrize("flood", FLOODS)
def test_a_ledger_of_faults_is_refused_at_once_and_kept_as_it_is(
    tmp_path: Path, flood: str
) -> None:
    """Each took up to 7 GB and a minute, or passed for a sound ledger."""
    piece, times, said = FLOODS[flood]
    path = tmp_path / "counters.jsonl"
    path.write_bytes(piece * times)
    found = measured("maintenance", "list", "--ledger", path)
    assert found.code == 4
    assert said in found.text
    assert len(found.text) < 30_000
    assert found.peak_mb < 250
    assert found.cpu_s < 5
    with pytest.raises(RecordError, match="is not a ledger"):
        read_book(path).expect_ledger()
