"""Many runs at once: found by their manifests, read one after the other.

runs = jbclog.open_runs("runs", line="bench-3", order="88123")
runs.manifests()                                   # a row a run
for piece in runs.samples(columns=["time", "station", "port", "temperature_c"]):
    ...                                            # DataFrames of some 30 000 rows, each with its `run`
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import fields
from functools import cached_property
from math import isclose
from pathlib import Path
from typing import Final, overload

import pandas as pd

from jbclog.analysis.joint_table import JOINTS_SCHEMA
from jbclog.analysis.notebook_html import runs_html
from jbclog.analysis.run import Run, open_run
from jbclog.analysis.run_metrics import METRICS
from jbclog.analysis.run_tables import Moment, utc
from jbclog.core.errors import RecordError, UsageError
from jbclog.record.find_runs import Filter, Found, Unreadable, find

# -- sampling rates -----------------------------------------------------------------------------------------------------------
# How often stations were sampled, where runs are held against each other.

WHAT_A_RATE_CHANGES: Final = (
    "what is found in the readings (joints, recovery, dips, alarm episodes, energy) depends on how often there is one"
)


def rate_text(period_s: float | None) -> str:
    """``5 Hz``; of a station that was asked without pause ``max``."""
    return "max" if period_s is None else f"{1 / period_s:.3g} Hz"


def is_same_rate(one_s: float | None, two_s: float | None) -> bool:
    """Of two periods in seconds; without pause both are None."""
    return one_s == two_s if one_s is None or two_s is None else isclose(one_s, two_s)


# -- runs ---------------------------------------------------------------------------------------------------------------------

TEXTS: Final = ("run", "state", "verdict", "line", "operator", "order", "product", "exit_status", "lost", "changed")
TIMES: Final = ("started", "ended")
LISTS: Final = ("stations", "recipes", "units", "wire_lots", "flux_lots", "tips")
COLUMNS: Final = ("run", *TIMES, *TEXTS[1:], "exit_code", *LISTS, "tags", "folder")


class Runs(Sequence[Run]):
    """Runs that fit, in the order of their starts. Manifests are read when they are first needed, tables when asked for.

    `unreadable` are folders of which nobody can say whether they fit. `refreshed()` looks again.
    """

    def __init__(self, folder: Path, wanted: Filter) -> None:
        self.folder = folder
        self.wanted = wanted

    @cached_property
    def _looked(self) -> tuple[list[Found], list[Unreadable]]:
        found: list[Found] = []
        unreadable: list[Unreadable] = []
        for one in find(self.folder, self.wanted):
            (found if isinstance(one, Found) else unreadable).append(one)  # type: ignore[arg-type]  # each into its own
        return found, unreadable

    @property
    def found(self) -> list[Found]:
        """What their manifests say, a `Found` a run."""
        return self._looked[0]

    @property
    def unreadable(self) -> list[Unreadable]:
        """Folders of which nothing can be told, and why."""
        return self._looked[1]

    def refreshed(self) -> Runs:
        """The same question, asked anew."""
        return Runs(self.folder, self.wanted)

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, place: int) -> Run: ...
    @overload
    def __getitem__(self, place: slice) -> list[Run]: ...
    def __getitem__(self, place: int | slice) -> Run | list[Run]:
        if isinstance(place, slice):
            return [open_run(one.folder) for one in self.found[place]]
        return open_run(self.found[place].folder)

    def __iter__(self) -> Iterator[Run]:
        return (open_run(one.folder) for one in self.found)

    def __repr__(self) -> str:
        more = f", {len(self.unreadable)} unreadable" if self.unreadable else ""
        return f"<Runs {self.folder}: {len(self)} run{'' if len(self) == 1 else 's'}{more}>"

    def _repr_html_(self) -> str:
        return runs_html(self.folder, self.found, self.unreadable)

    def manifests(self) -> pd.DataFrame:
        """A row a run: who, what, when and what came of it. Times in UTC; `stations`, `units` and other lists are tuples."""
        rows = [{**{name: getattr(one, name, None) for name in COLUMNS}, "run": one.folder.name} for one in self.found]
        frame = pd.DataFrame(rows, columns=list(COLUMNS))
        for name in TIMES:
            frame[name] = pd.to_datetime(frame[name], utc=True, format="ISO8601").astype("datetime64[us, UTC]")
        frame["folder"] = frame["folder"].map(str)
        return frame.astype(dict.fromkeys((*TEXTS, "folder"), "str") | {"exit_code": "Int64"})

    def samples(
        self,
        station: str | None = None,
        port: int | None = None,
        start: Moment | None = None,
        stop: Moment | None = None,
        columns: Sequence[str] | None = None,
    ) -> Iterator[pd.DataFrame]:
        """The samples of all runs, a piece at a time (at most a row group of some 33 000 rows), `run` in front.

        Nothing is kept, so a month of 32 stations takes no more memory than an hour. `pd.concat` of it is the whole table, where
        there is room for it.
        """
        for run in self:
            for piece in run.stream("samples", station, port, start, stop, columns):
                piece.insert(0, "run", run.name)
                yield piece

    def metrics(self, station: str | None = None) -> pd.DataFrame:
        """The metrics of all runs (`Run.metrics`), `run` and `started` in front."""
        return self._of_each(lambda run: run.metrics(station), METRICS)

    def joints(self, station: str | None = None) -> pd.DataFrame:
        """The joints of all runs (`Run.joints`), `run` and `started` in front."""
        return self._of_each(lambda run: run.joints(station), JOINTS_SCHEMA.names)

    def _of_each(self, table: Callable[[Run], pd.DataFrame], columns: Iterable[str]) -> pd.DataFrame:
        frames = []
        for one in self.found:
            frame = table(open_run(one.folder))
            frame.insert(0, "started", utc(one.started))
            frame.insert(0, "run", one.folder.name)
            frames.append(frame)
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame(columns=["run", "started", *columns])


def open_runs(
    folder: str | os.PathLike[str] = "runs",
    *,
    since: Moment | None = None,
    until: Moment | None = None,
    tags: Mapping[str, str] | None = None,
    **texts: str | None,
) -> Runs:
    """The runs below `folder` that fit, found by their manifests alone and read when asked for.

    Texts are `operator`, `order`, `product`, `unit`, `wire_lot`, `flux_lot`, `tip`, `line`, `station`, `recipe`
    (``NAME`` or ``NAME@REVISION``), `verdict`, `state`; each fits whole, ``*`` stands for any characters. `since` is included,
    `until` is not; both are of a run's start, UTC where they name no zone. Raises `UsageError` and `RecordError`.
    """
    path = Path(folder)
    if not path.is_dir():
        raise RecordError(f"{path} is not there, or is no folder")
    known = {one.name for one in fields(Filter)} - {"since", "until", "ended_since", "tags"}
    unknown = sorted(texts.keys() - known)
    if unknown:
        raise UsageError(f"runs cannot be filtered by {', '.join(unknown)}; by {', '.join(sorted(known))}, since, until and tags")
    return Runs(path, Filter(since=utc(since), until=utc(until), ended_since=None, tags=tags or {}, **texts))
