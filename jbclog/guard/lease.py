"""The lease: the tools that a run may leave hot, stored in the run's folder; and the registry of
this user's open leases.
"""

from __future__ import annotations

import json
import os
import stat
import time
import zlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Final, NamedTuple

from jbclog.core.errors import RecordError
from jbclog.core.files import Kind, read_regular
from jbclog.core.json_files import builder, json_of
from jbclog.core.locks import try_lock
from jbclog.core.serial_line import is_one_port

NAME: Final = "lease.json"
NEW: Final = "lease.json.new"  # until it is renamed
LOCK: Final = "guard.lock"
LOCK_RETRY_S: Final = 0.02
REGISTRY: Final = "jbclog/open-leases"
TRIAL: Final = ".trial-"
NO_HOME: Final = "this user has no home folder"
NOT_THERE: Final = (
    "{folder} is not there, and its disk may not be mounted (if you removed it, remove {link}, too)"
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
        lines = read_regular(folder / NAME, Kind.LEASE).splitlines()
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


# The registry is a folder with a link to each run that holds a lease, so that a later start finds
# runs anywhere (`--out`): in the user's state folder; where that cannot be written, in the runtime
# folder, which a restart of the host empties. Where neither can, only the folder of runs itself is
# left: the next run with the same `--out` finds the leases in the runs' folders. All are read. The
# lease in the run's folder is authoritative. A run whose folder is not there is named and never
# forgotten: its disk may not be mounted, and its tools may be hot. Only a person knows that it was
# removed, and removes its link.


class Leases(NamedTuple):
    """The folders of runs with open leases: `there`; and `away`, each with the reason, those that
    may have one and cannot be looked at, as on a disk that is not mounted.
    """

    there: list[Path]
    away: list[tuple[Path, str]]


def registered_runs() -> Leases:
    """Return the folders of the runs in the registries."""
    runs = Leases([], [])
    for link in _links():
        with suppress(OSError):
            folder = link.readlink()
            why = _why_away(folder, link)
            if why is None:
                runs.there.append(folder)
            else:
                runs.away.append((folder, why))
    return runs


def _why_away(folder: Path, link: Path) -> str | None:
    """Return why the folder of a run cannot be looked at; None if it can."""
    try:
        is_folder = stat.S_ISDIR(folder.stat().st_mode)
    except (FileNotFoundError, NotADirectoryError):
        is_folder = False
    except OSError as error:
        return f"{folder} cannot be looked at ({error.strerror or error})"
    return None if is_folder else NOT_THERE.format(folder=folder, link=link)


def runs_below(out: Path) -> Leases:
    """Return the folders of runs directly below `out` with open leases. A link may be one to a
    run's folder elsewhere.
    """
    runs = Leases([], [])
    for folder in _entries(out):
        with suppress(OSError):
            if os.path.exists(f"{folder}/{NAME}"):  # noqa: PTH110  # a path for each takes longer
                runs.there.append(Path(os.path.realpath(folder)))
    return runs


def _entries(out: Path) -> list[str]:
    """Return what is in `out`, sorted. A start waits for this: there may be ten thousand runs."""
    with suppress(OSError):
        return sorted(f"{out}/{name}" for name in os.listdir(out))  # noqa: PTH208  # ten thousand
    return []


def _inside(folder: Path) -> list[Path]:
    with suppress(OSError):
        return sorted(folder.iterdir())
    return []


class Listing(NamedTuple):
    """Where this user's open leases are listed: the registry that can be written, None if none can;
    why each earlier one cannot; and whether it lasts beyond a restart of the host.
    """

    registry: Path | None
    why_not: tuple[str, ...]
    is_lasting: bool


def listing(folder: Path) -> Listing:
    """Return where a run in `folder` will be listed, by listing it and removing it again."""
    name = f"{TRIAL}{os.getpid()}"
    found = _list(folder, name)
    if found.registry is not None:
        with suppress(OSError):
            (found.registry / name).unlink(missing_ok=True)
    return found


def families_leased(besides: Path | None = None) -> set[str] | None:
    """Return the families of this user's listed leases, except those of the run in `besides`; None
    if one of them may be missing.
    """
    if _state() is None and not _runtime().is_dir():
        return None
    runs = registered_runs()
    if runs.away:
        return None
    own = None if besides is None else os.path.realpath(besides)
    families: set[str] = set()
    for folder in runs.there:
        if os.path.realpath(folder) == own:
            continue
        leases, wrong = _read(folder)
        if wrong:
            return None
        families |= {station.family for station in leases}
    return families


def _register(folder: Path) -> None:
    # the checksum separates runs of one name in two folders
    checksum = zlib.crc32(os.fsencode(os.path.realpath(folder)))
    with suppress(OSError):
        _list(folder, f"{folder.name}-{checksum:08x}")


def _list(folder: Path, name: str) -> Listing:
    """Put a link to a run into the first registry that can be written."""
    target, why_not = os.path.realpath(folder), list[str]()
    for base, is_lasting in ((_state(), True), (_runtime(), False)):
        if base is None:
            why_not.append(NO_HOME)
            continue
        registry = base / REGISTRY
        try:
            if not is_lasting:  # the system makes it
                base.stat()
            registry.mkdir(parents=True, exist_ok=True, mode=0o700)
            if not (registry / name).is_symlink():
                (registry / name).symlink_to(target)
        except OSError as error:
            why_not.append(f"{registry}: {error.strerror or error}")
        else:
            return Listing(registry, tuple(why_not), is_lasting)
    return Listing(None, tuple(why_not), is_lasting=False)


def _state() -> Path | None:
    """Return the user's state folder, which may not exist; None without a home folder."""
    given = Path(os.environ.get("XDG_STATE_HOME", ""))
    if given.is_absolute():
        return given
    home = Path(os.path.expanduser("~"))  # noqa: PTH111  # raises nothing
    return home / ".local" / "state" if home.is_absolute() else None


def _runtime() -> Path:
    """Return the user's runtime folder, which may not exist."""
    given = Path(os.environ.get("XDG_RUNTIME_DIR", ""))
    return given if given.is_absolute() else Path(f"/run/user/{os.geteuid()}")


def _links() -> list[Path]:
    """Return the links of all registries; without those of a `listing` in progress."""
    return [
        link
        for base in (_state(), _runtime())
        if base is not None
        for link in _inside(base / REGISTRY)
        if not link.name.startswith(TRIAL)
    ]


def _unregister(folder: Path) -> None:
    """Remove every link to the run, whatever its name."""
    path = Path(os.path.realpath(folder))
    for link in _links():
        with suppress(OSError):
            if link.readlink() == path:
                link.unlink(missing_ok=True)
