"""A record that no reader would take is refused before a station is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from jbclog.app.run.plan import Metadata, RunOptions, make_plan
from jbclog.core.errors import RecordError
from support.records.report_runs import RECIPE, STATION
from support.virtual.recorded_run import RecordedRun

MOST_TAGS = {f"t{number}": "v" for number in range(1000)}
TOO_MUCH = {
    "1001 tags, at most 1000": Metadata(tags=MOST_TAGS | {"one": "more"}),
    "200001 stated units, at most 200000": Metadata(units=["S"] * 200_001),
    "its manifest has [0-9]+ bytes": Metadata(units=["S" * 500] * 40_000),
}


def recorded(tmp_path: Path, stated: Metadata) -> Path:
    line, recipe = tmp_path / "line.toml", tmp_path / "tht.toml"
    line.write_text('[line]\nname = "bench-3"\n' + STATION.format(family="dde", number=1, sim=""))
    recipe.write_text(RECIPE)
    plan = make_plan(RunOptions(line, recipe, duration_s=1.0, rate=2.0, metadata=stated))
    return RecordedRun(plan, tmp_path / "runs").result.folder


@pytest.mark.parametrize("why", TOO_MUCH)
def test_too_much_for_one_record_is_refused_at_the_start(tmp_path: Path, why: str) -> None:
    with pytest.raises(
        RecordError, match=f"too much for one record: {why}.*No station was touched"
    ):
        recorded(tmp_path, TOO_MUCH[why])


def test_as_much_as_is_allowed_is_recorded_and_read(tmp_path: Path) -> None:
    from jbclog import open_run

    assert (
        len(open_run(recorded(tmp_path, Metadata(tags=MOST_TAGS))).manifest.metadata.tags) == 1000
    )
