"""Virtual stations in a process of their own, with a note of each question and what was said to it,
faults or none.

``python tests/support virtual.tapped_sim LINE DIR NOTES [PART ...]``, ended as `jbclog.sim` is when
its stdin is closed. `jbclog sim --log` notes bytes as they pass, which do not tell to which
question an answer belongs where others went unanswered; these do.
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from time import monotonic

from support import program
from support.product import (
    SERVED_LINE,
    Reply,
    SimProcess,
    VirtualOmega,
    VirtualStation,
    load_line,
    set_up_sim,
    virtual_station,
)
from support.virtual.virtual_run import Heard, Tap


class Tapped:
    """A station as a server serves it; each question goes into `notes` as one line."""

    def __init__(self, station: VirtualStation | VirtualOmega, notes: Path) -> None:
        self._station, self._tap = station, Tap(station)
        self._file = notes.open("a", encoding="utf-8", buffering=1)
        self.name = station.name

    def receive(self, data: bytes, now: float) -> Sequence[Reply]:
        replies = self._tap.receive(data, now)
        one = self._tap.heard.pop()
        self._file.write(json.dumps([self.name, one.at, one.text, one.clean, one.sent]) + "\n")
        return replies  # type: ignore[return-value]  # what the station gave

    def is_unplugged(self, now: float) -> bool:
        return self._station.is_unplugged(now)

    def next_plugging(self, now: float) -> float | None:
        return self._station.next_plugging(now)


class TappedSim(SimProcess):
    """The process, for as long as a `with` lasts.

    `parts` are line files that have the line's stations between them, in its order, with their
    faults: an hour's faults of sixteen stations are more than one file may have.
    """

    def __init__(self, line: Path, folder: Path, notes: Path, parts: Sequence[Path] = ()) -> None:
        super().__init__(line, folder)
        self._command = program("virtual.tapped_sim", line, folder, notes, *parts)


def heard_in(notes: Path) -> dict[str, list[Heard]]:
    """By station: every question in the order of time, in monotonic seconds."""
    found: dict[str, list[Heard]] = defaultdict(list)
    with notes.open(encoding="utf-8") as lines:
        for line in lines:
            station, at, text, clean, sent = json.loads(line)
            found[station].append(Heard(at, text, clean, sent))
    return found


def main() -> None:
    path, folder, notes, *parts = map(Path, sys.argv[1:])
    specs, now = (
        [spec for part in parts or [path] for spec in load_line(part).stations],
        monotonic(),
    )
    server = set_up_sim(
        load_line(path),
        folder,
        stations=[Tapped(virtual_station(spec, now=now), notes) for spec in specs],
    )
    server.stop_on_signals()
    server.stop_at_end_of(sys.stdin.fileno())
    print((folder / SERVED_LINE).absolute(), flush=True)
    server.run()


if __name__ == "__main__":
    main()
