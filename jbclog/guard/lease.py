"""The lease: the tools that a run may leave hot, stored in the run's folder; and the registry of
this user's open leases.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.core.errors import RecordError
from jbclog.core.foreign.files import Kind, read_foreign, why_hangs, why_link_hangs
from jbclog.core.foreign.json_reader import builder, json_of
from jbclog.core.locks import try_lock
from jbclog.core.serial_line import is_one_port

NAME: Final = "lease.json"
NEW: Final = "lease.json.new"  # until it is renamed
LOCK: Final = "guard.lock"
LOCK_RETRY_S: Final = 0.02
REGISTRY: Final = "jbclog/open-leases"
NOT_THERE: Final = (
    "{target} is not there, and its disk may not be mounted (if you removed it, remove {link}, too)"
)
FLAGS: Final = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW


@dataclass(frozen=True, slots=True)
class StationLease:
    """One station with tools that a run has heated. `ports`: those that may be hot.

    Nothing is written to a station unless it answers `model` and `software`. If the model's name
    does not prove the family, `model_accepted` must hold: the line file accepts the model, and the
    run confirmed the family by reads. `suction`: ports whose suction was last confirmed on, and
    stays on.
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
        """True if a tool or the feeder has to be made safe."""
        return bool(self.ports) or self.feeds

    def is_at(self, url: str) -> bool:
        return is_one_port(self.url, url)

    def to_json(self) -> str:
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> StationLease:
        """Parse a lease. Raises ValueError, also for a key of a later version, which may forbid
        what this version would do, and for one that is missing.
        """
        plain = json_of(text)
        lease = _build_station_lease(plain)
        keys = {one.name for one in fields(cls)}
        if unknown := plain.keys() - keys:
            raise ValueError(f"unknown keys {', '.join(sorted(unknown))}")
        if missing := keys - plain.keys():
            raise ValueError(f"missing keys {', '.join(sorted(missing))}")
        return lease


_build_station_lease: Final = builder(StationLease)


def write_leases(folder: Path, stations: Iterable[StationLease]) -> None:
    """Replace the leases of a run and register its folder for this user; remove both if nothing is
    held. Raises OSError.
    """
    held = [station for station in stations if station.holds]
    if not held:
        for name in (NAME, NEW):  # the latter from a guard killed while writing
            (folder / name).unlink(missing_ok=True)
        _unregister(folder)
        return
    _replace_file(folder / NAME, "".join(f"{station.to_json()}\n" for station in held))
    _sync(folder)
    _register(folder)


def _replace_file(path: Path, text: str) -> None:
    """Write the whole file, never through a link. Raises OSError."""
    new = path.with_name(NEW)
    new.unlink(missing_ok=True)
    try:
        with os.fdopen(os.open(new, FLAGS, 0o644), "w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        new.replace(path)
    except BaseException:  # memory can be refused here, too
        with suppress(OSError):
            new.unlink()
        raise


def _sync(folder: Path) -> None:
    """Sync the folder, so that a new name in it survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def read_leases(folder: Path) -> list[StationLease]:
    """Return the readable leases of a run."""
    return _read(folder)[0]


def why_unreadable(folder: Path) -> str:
    """Return why the lease file or a line of it cannot be read; empty if it can, or is missing."""
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
        except ValueError:  # an unreadable line must not hide the others
            wrong = f"line {number} is no lease of a station"
    return found, wrong


@contextmanager
def guard_lock(folder: Path, patience_s: float = 0.0) -> Iterator[None]:
    """Hold a run's guard lock, which ends with its holder. Raises RecordError if another process
    has it.
    """
    descriptor = _locked(folder, time.monotonic() + patience_s)
    try:
        yield
        (folder / LOCK).unlink(missing_ok=True)
    finally:
        os.close(descriptor)


def _locked(folder: Path, end: float) -> int:
    while True:
        descriptor = try_lock(folder / LOCK)
        if descriptor is not None:
            return descriptor
        if time.monotonic() >= end:
            raise RecordError(f"{folder} has a guard already")
        time.sleep(LOCK_RETRY_S)


# The registry is a folder in the user's state folder, with a link to each run that holds a lease,
# so that a later start finds runs anywhere (`--out`). It may be incomplete, for example without a
# home folder; the lease in the run's folder is authoritative. A run whose disk is not mounted is
# not forgotten: its tools may be hot.


class Leases(NamedTuple):
    """The folders of runs with open leases: `there`; and `away`, each with the reason, those that
    may have one and cannot be looked at, as on a disk that is not mounted, or a network mount that
    hangs.
    """

    there: list[Path]
    away: list[tuple[Path, str]]


def registered_runs() -> Leases:
    """Return the folders of runs with open leases; forget those whose disk is there without
    them.
    """
    registry, found = _registry(), Leases([], [])
    for link in [] if registry is None else _inside(registry):
        with suppress(OSError):
            target = link.readlink()
            why = _why_away(target)
            if why is None and target.is_dir():
                found.there.append(target)
            elif why is None and _is_removed(target, link):
                link.unlink(missing_ok=True)
            else:
                found.away.append((target, why or NOT_THERE.format(target=target, link=link)))
    return found


def runs_below(out: Path) -> Leases:
    """Return the folders of runs directly below `out` with open leases. A link may be one to a
    run's folder elsewhere.
    """
    found = Leases([], [])
    for folder, is_link in _entries(out):
        with suppress(OSError):
            why = why_link_hangs(Path(folder)) if is_link else None
            if why is not None:
                found.away.append((Path(folder), why))
            elif os.path.exists(f"{folder}/{NAME}"):  # noqa: PTH110  # a path for each takes longer
                found.there.append(Path(os.path.realpath(folder)))
    return found


def _entries(out: Path) -> list[tuple[str, bool]]:
    """Return what is in `out`, sorted, and whether it is a link. A start waits for this: there may
    be ten thousand runs.
    """
    with suppress(OSError), os.scandir(out) as entries:
        return sorted((entry.path, entry.is_symlink()) for entry in entries)
    return []


def _inside(folder: Path) -> list[Path]:
    with suppress(OSError):
        return sorted(folder.iterdir())
    return []


def _why_away(folder: Path) -> str | None:
    """Return why `folder` cannot be looked at; None where it can, and where nothing is there."""
    why = why_hangs(folder)
    if why is None:
        try:
            folder.stat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            return f"{folder} cannot be looked at ({error.strerror or error})"
    return why


def _registry() -> Path | None:
    state = os.environ.get("XDG_STATE_HOME", "")
    try:
        return (
            Path(state) if Path(state).is_absolute() else Path.home() / ".local" / "state"
        ) / REGISTRY
    except RuntimeError:
        return None


def _register(folder: Path) -> None:
    registry = _registry()
    if registry is None:
        return
    with suppress(OSError):
        registry.mkdir(parents=True, exist_ok=True, mode=0o700)
        link = registry / f"{_link_name(folder)}.{_file_system(folder)}"
        link.symlink_to(os.path.realpath(folder))


def _unregister(folder: Path) -> None:
    registry, name = _registry(), _link_name(folder)
    for link in [] if registry is None else _inside(registry):
        if name in (link.stem, link.name):  # the latter of earlier versions
            with suppress(OSError):
                link.unlink(missing_ok=True)


def _link_name(folder: Path) -> str:
    """Return the name of a run's link without its file system; the checksum separates runs of one
    name in two folders.
    """
    path = os.path.realpath(folder)
    return f"{folder.name}-{zlib.crc32(os.fsencode(path)):08x}"


def _is_removed(target: Path, link: Path) -> bool:
    """Whether the file system that held the run's folder is still there, without the folder. Its
    number is the end of the link's name; elsewhere, as at the point where a disk is not mounted,
    there is another file system.
    """
    with suppress(OSError):
        above = next(folder for folder in target.parents if folder.is_dir())
        return link.suffix == f".{_file_system(above)}"
    return False


def _file_system(folder: Path) -> str:
    """Return the number of the file system, which a restart does not change on most; that of its
    device where it has none, as on a share. Raises OSError.
    """
    return f"{os.statvfs(folder).f_fsid or folder.stat().st_dev:x}"
