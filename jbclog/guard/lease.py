"""The lease: what must be made safe if nobody renews it, station by station. Kept in the run's folder while it runs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Final

from jbclog.core.foreign.files import Kind, read_foreign
from jbclog.core.foreign.json_reader import build, json_of
from jbclog.core.serial_line import is_one_port
from jbclog.guard import lease_registry

NAME: Final = "lease.json"
FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW


@dataclass(frozen=True, slots=True)
class StationLease:
    """One station whose tools a run has touched. `ports` are those that may be hot.

    `model` and `software` are what the station must answer before anything is written to it. Where the name does not prove the
    family, nothing is unless `model_accepted`: the line file accepts it, and the run has borne the family out by reads.
    `suction` are those of the ports whose suction is on, as last confirmed, and is kept on; leases of the first release do not
    have it.
    """

    name: str
    url: str
    baudrate: int
    format: str
    address: int | None
    family: str
    model: str | None
    software: str | None
    safe_state: str
    ports: tuple[int, ...]
    feeds: bool
    model_accepted: bool = False
    suction: tuple[int, ...] = ()

    @property
    def holds(self) -> bool:
        """Whether there is anything to be made safe."""
        return bool(self.ports) or self.feeds

    def is_at(self, url: str) -> bool:
        """Whether its port is the one at `url`."""
        return is_one_port(self.url, url)

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> StationLease:
        """Raises `ValueError` where `text` is no lease, or says more than this version knows: it may be what must not be done."""
        told = json_of(text)
        try:
            lease = build(cls, told)
        except ValueError as error:
            raise ValueError(f"no lease: {error}") from error
        if unknown := told.keys() - {one.name for one in fields(cls)}:
            raise ValueError(f"no lease: {', '.join(sorted(unknown))} is not known")
        return lease


def keep(folder: Path, stations: Iterable[StationLease]) -> None:
    """Put the lease into the run's folder, so that the next start finds what a dead host left hot; none removes it.

    The user's other runs, and `jbclog safe`, find the folder. Raises `OSError`.
    """
    held = [station for station in stations if station.holds]
    if not held:
        with suppress(FileNotFoundError):
            (folder / NAME).unlink()
        lease_registry.forget(folder)
        return
    _put(folder / NAME, "".join(f"{station.to_json()}\n" for station in held))
    _sync(folder)
    lease_registry.note(folder)


def _put(path: Path, text: str) -> None:
    """The old lease or the new one, never half of one, and nothing beside it; never through a link. Raises `OSError`."""
    beside = path.with_name(f"{NAME}.new")
    beside.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(beside, FLAGS, 0o644), "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)
    except OSError:
        with suppress(OSError):
            beside.unlink()
        raise


def _sync(folder: Path) -> None:
    """A name that is not synced can be gone after a power cut."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def kept(folder: Path) -> list[StationLease]:
    """What stands in the lease in this folder, as far as it can be read; nothing where there is none."""
    return _read(folder)[0]


def unreadable(folder: Path) -> str:
    """Why the lease in this folder, or a line of it, cannot be read; empty where it can be, or there is none."""
    return _read(folder)[1]


def _read(folder: Path) -> tuple[list[StationLease], str]:
    try:
        lines = read_foreign(folder / NAME, Kind.LEASE).splitlines()
    except FileNotFoundError:
        return [], ""
    except (OSError, ValueError) as error:
        return [], str(error)
    found, wrong = [], ""
    for number, line in enumerate(lines, 1):
        try:
            found.append(StationLease.from_json(line))
        except ValueError:  # one that cannot be read must not hide the others
            wrong = f"line {number} is no lease of a station"
    return found, wrong
