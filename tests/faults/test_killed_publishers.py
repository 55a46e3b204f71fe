"""Two publishers of one run, each killed (SIGKILL) at one of its commits: in the end there is one
copy, and it is whole.

What a killed publisher left behind does not count. `store check` removes it; then each table has
the rows of the run and no others.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path

import pytest
from deltalake import DeltaTable

import jbclog
from jbclog.analysis.store.place import Place, place_of
from jbclog.analysis.store.schema import DATA, RUNS
from jbclog.app.publish.lease import leases
from jbclog.app.publish.publisher import Publisher, Result
from jbclog.app.publish.upkeep import SWEPT_AFTER, check
from support.campaigns.slices import first
from support.faults.killed_publisher import COMMITS, start
from support.records import small_run

DEATHS = [(number, when) for number in range(COMMITS, 0, -1) for when in ("after", "before")]
AT_ONCE = timedelta(0)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_run.make_run(tmp_path_factory.mktemp("runs"), 12.0)


def expected(run: Path) -> dict[str, int]:
    whole = jbclog.open_run(run)
    return {name: len(getattr(whole, name)()) for name in DATA} | {RUNS: 1}


def there(place: Place) -> dict[str, int]:
    return {
        name: DeltaTable(place.of(name)).to_pyarrow_dataset().count_rows() for name in (*DATA, RUNS)
    }


def killed(run: Path, place: Place, *deaths: tuple[int, str]) -> None:
    """Publish with one process for each death, all at once; each is killed, or finds that the other
    has published the run.
    """
    Publisher(place).__exit__()  # makes the tables, whose creation belongs to no publication
    for one in [start(run, Path(place.url), number, when) for number, when in deaths]:
        said, wrong = one.communicate(timeout=120)
        assert one.returncode in (-signal.SIGKILL, 0), said + wrong
        assert one.returncode == -signal.SIGKILL or any(
            result.value in said for result in (Result.THERE, Result.PUBLISHED)
        )


def in_the_end(run: Path, place: Place) -> None:
    """The next publisher finds the run or publishes it; then there is one copy, and nothing is left
    of others.
    """
    with Publisher(place) as last:
        assert last.publish(run).result in (Result.PUBLISHED, Result.THERE)
    (read,) = jbclog.open_runs(place.url)
    assert {name: len(getattr(read, name)()) for name in DATA} | {RUNS: 1} == expected(run)
    found = check(place, AT_ONCE)
    assert (found.findings, found.runs) == ([], 1)
    assert there(place) == expected(run)
    assert [*leases(place)] == []
    assert check(place, AT_ONCE).leftovers == []


@pytest.mark.parametrize("trial", first(1, range(len(DEATHS))))
def test_one_is_killed(run: Path, tmp_path: Path, trial: int, counted: Callable[..., None]) -> None:
    place = place_of(tmp_path / "store")
    killed(run, place, DEATHS[trial])
    is_done = DEATHS[trial] == (COMMITS, "after")
    # nothing of it counts before its last commit
    assert len(jbclog.open_runs(place.url)) == is_done
    in_the_end(run, place)
    counted(publishers_killed=1)


@pytest.mark.campaign
@pytest.mark.timeout(1800)
def test_two_are_killed(run: Path, tmp_path: Path, counted: Callable[..., None]) -> None:
    trials = [
        # each death once for each of the two
        *((one, DEATHS[(7 * number + 3) % len(DEATHS)]) for number, one in enumerate(DEATHS)),
        ((COMMITS, "before"),) * 2,
        ((COMMITS, "after"),) * 2,
    ]
    for number, deaths in enumerate(trials):
        place = place_of(tmp_path / f"store-{number}")
        killed(run, place, *deaths)
        in_the_end(run, place)
        counted(pairs_of_publishers_killed=1)


def test_what_is_younger_stays(run: Path, tmp_path: Path) -> None:
    """A publisher may be slow: its rows stay for a day unless somebody asks for less; they do not
    count as a run.
    """
    place = place_of(tmp_path / "store")
    killed(run, place, (COMMITS, "before"))
    assert len(jbclog.open_runs(place.url)) == 0
    before = there(place)
    found = check(place, SWEPT_AFTER)
    assert found.findings == []
    assert len(found.leftovers) == len(DATA)
    assert all(text.endswith("younger than 24 h") for text in found.leftovers)
    assert there(place) == before
    in_the_end(run, place)
