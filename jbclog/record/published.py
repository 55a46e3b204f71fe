"""The published tree: runs of many lines in one folder, on a share, or in S3, for every reader of
Parquet.

::

    TABLE/samples/line=bench-3/month=2026-11/RUN.part-0001.parquet   the sealed part, byte for byte
    TABLE/annotations/line=bench-3/month=2026-11/RUN.jsonl
    TABLE/runs/line=bench-3/month=2026-11/RUN.json                   the manifest

1. The name of a run decides all its keys: the same run has the same keys and bytes.
2. The manifest is written last. A run without one is not published yet, and is not seen.
3. A key of the path (`line`, `month`) is no column of a table: readers would refuse the two types.
4. Files and listings go through the file systems of pyarrow. S3 takes its credentials from the
   environment only.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jbclog.core.chain import sha256
from jbclog.core.errors import RecordError, UsageError
from jbclog.core.files import MIB
from jbclog.core.operating_system import sync_file, sync_folder
from jbclog.core.text import clean, shortened
from jbclog.record.annotations import NAME as ANNOTATIONS
from jbclog.record.annotations import annotations_in, late_in
from jbclog.record.find_runs import ALL, Filter, Found, Unreadable, find, summary_in
from jbclog.record.folder import DERIVED, DERIVED_TABLES, RUN_NAME, derived_file
from jbclog.record.manifest import NAME as MANIFEST
from jbclog.record.manifest import read_manifest

if TYPE_CHECKING:
    import pyarrow.fs as pf

if sys.platform == "win32":
    from pathlib import WindowsPath as SystemPath
else:
    from pathlib import PosixPath as SystemPath

RUNS: Final = "runs"
MADE_LATER: Final = (*(derived_file(table) for table in DERIVED_TABLES), "report.json")
"""Files that are made after sealing, and may change."""
S3: Final = re.compile(r"s3a?:/+(.+)", re.DOTALL)  # a `Path` drops one of the two slashes
URL: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+:/")  # `C:/` is a drive of Windows
CREDENTIALS: Final = (
    "; credentials come from the environment: AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION,"
    " and AWS_ENDPOINT_URL for a server other than Amazon's"
)
CONNECT_S: Final = 5.0
REQUEST_S: Final = 30.0
ATTEMPTS: Final = 3
THREADS: Final = 16  # read manifests
LEFT_S: Final = 86_400.0  # no publisher writes a file for so long
MOST_SAID: Final = 400  # characters of an error's text


class TreePath(SystemPath):
    """A path in a tree. Its text has both slashes of ``s3://``, of which a path drops one."""

    def __str__(self) -> str:
        text = super().__str__()
        remote = S3.fullmatch(text.replace(os.sep, "/"))
        return text if remote is None else f"s3://{remote[1]}"

    def absolute(self) -> TreePath:
        """Return the path itself: the path of a tree is absolute."""
        return self


@dataclass(frozen=True, slots=True)
class Stored:
    """A file of a tree: its size in bytes, and when it was written, in seconds since 1970."""

    size: int
    written_s: float


@dataclass(frozen=True, slots=True)
class Tree:
    """A published tree at an absolute path or ``s3://BUCKET/PATH``. Methods raise `RecordError`."""

    url: str

    @classmethod
    def at(cls, given: str | os.PathLike[str]) -> Tree:
        """Return the tree at the place that a user names. Raises `UsageError` for another kind of
        URL, and for one with credentials.
        """
        text = os.fspath(given)
        remote = S3.fullmatch(text)
        if remote is None and URL.match(text):
            raise UsageError(f"{clean(text)}: must be a folder or s3://BUCKET/PATH")
        if remote is None:
            return cls(os.path.abspath(text))  # noqa: PTH100  # `resolve` would follow links
        if "@" in remote[1]:
            raise UsageError(f"s3://…: a URL must not contain credentials{CREDENTIALS}")
        return cls(f"s3://{remote[1].rstrip('/')}")

    @property
    def is_remote(self) -> bool:
        """Whether the tree is in S3."""
        return self.url.startswith("s3://")

    @property
    def path(self) -> TreePath:
        """The tree as a path."""
        return TreePath(self.url)

    def __str__(self) -> str:
        return self.url

    def files(self) -> pf.FileSystem:
        """Return the tree as a file system; names are keys."""
        return _files(self.url, os.environ.get("AWS_ENDPOINT_URL"))

    def stored(self, keys: Iterable[str]) -> dict[str, Stored]:
        """Return those of the keys that exist."""
        return self._stored([*keys])

    def below(self, folder: str) -> dict[str, Stored]:
        """Return all keys below a folder of the tree; none if it is missing."""
        import pyarrow.fs as pf

        return self._stored(pf.FileSelector(folder, allow_not_found=True, recursive=True))

    def _stored(self, which: list[str] | pf.FileSelector) -> dict[str, Stored]:
        with explained(self):
            infos = self.files().get_file_info(which)
        return {
            info.path: Stored(info.size, info.mtime.timestamp()) for info in infos if info.is_file
        }

    def read(self, key: str) -> bytes | None:
        """Return the content of a file; None if it is missing."""
        with explained(self), suppress(FileNotFoundError), self.files().open_input_file(key) as it:
            return bytes(it.read())
        return None

    def put(self, key: str, pieces: Iterable[bytes]) -> None:
        """Write a file, whole or not at all. An error while the pieces are made leaves none."""
        try:
            with explained(self):
                if self.is_remote:
                    self._upload(key, pieces)
                else:
                    _write(Path(self.url, key), pieces)
        except FileNotFoundError as error:
            raise RecordError(f"{self}/{key} cannot be written: {error}") from error

    def _upload(self, key: str, pieces: Iterable[bytes]) -> None:
        try:
            with self.files().open_output_stream(key) as out:
                for piece in pieces:
                    out.write(piece)
        except BaseException:  # closing has stored what was written
            with suppress(OSError):
                self.files().delete_file(key)
            raise

    def runs(self) -> list[str]:
        """Return the names of the published runs, oldest first."""
        names = {key: key.rpartition("/")[2].removesuffix(".json") for key in self.below(RUNS)}
        return sorted(
            name
            for key, name in names.items()
            if RUN_NAME.fullmatch(name) and key == key_of(name, MANIFEST)
        )


@lru_cache
def _files(url: str, endpoint: str | None) -> pf.FileSystem:
    import pyarrow.fs as pf

    if not url.startswith("s3://"):
        return pf.SubTreeFileSystem(Path(url).as_posix(), pf.LocalFileSystem())
    s3 = pf.S3FileSystem(
        endpoint_override=endpoint,
        connect_timeout=CONNECT_S,
        request_timeout=REQUEST_S,
        retry_strategy=pf.AwsStandardS3RetryStrategy(max_attempts=ATTEMPTS),
        allow_delayed_open=True,  # a small file takes one request
    )
    return pf.SubTreeFileSystem(url.removeprefix("s3://"), s3)


@contextmanager
def explained(tree: Tree) -> Iterator[None]:
    """Turn an error of pyarrow into a `RecordError` of one line; `FileNotFoundError` passes."""
    from pyarrow import ArrowException

    try:
        yield
    except FileNotFoundError:
        raise
    except (OSError, ArrowException) as error:
        text = shortened(clean(" ".join(str(error).split())), MOST_SAID)
        advice = CREDENTIALS if tree.is_remote and "NETWORK" not in text else ""
        raise RecordError(f"{tree}: {text}{advice}") from error


def _write(path: Path, pieces: Iterable[bytes]) -> None:
    """Replace a file atomically, synced. Readers of Parquet folders ignore the name before."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    try:
        with aside.open("xb") as file:
            for piece in pieces:
                file.write(piece)
        sync_file(aside)
        aside.replace(path)
    finally:
        aside.unlink(missing_ok=True)
    sync_folder(path.parent)
    for left in path.parent.glob(f".{path.name}.*"):  # by a killed publisher
        with suppress(OSError):
            if time.time() - left.stat().st_mtime > LEFT_S:
                left.unlink()


def key_of(run: str, name: str) -> str:
    """Return the key of a file of a run: ``samples/part-0001.parquet`` of RUN is
    ``samples/line=…/month=…/RUN.part-0001.parquet``, ``derived/joints.parquet`` is
    ``joints/line=…/month=…/RUN.parquet``.

    Raises `RecordError` for a name that no run has.
    """
    parts = name.split("/")
    is_plain = len(parts) <= 2 and "\0" not in name and not {"", ".", ".."}.intersection(parts)
    if not is_plain or not RUN_NAME.fullmatch(run):
        raise RecordError(f"{run:.100}: {name!r:.100} is no file of a run")
    if name.startswith(f"{DERIVED}/"):
        parts = parts[1:]
    if len(parts) == 1:
        parts = parts[0].split(".", 1)
    if name == MANIFEST:
        parts[0] = RUNS
    line, month = run[17:-5], f"{run[:4]}-{run[4:6]}"
    return f"{parts[0]}/line={line}/month={month}/{run}.{parts[-1]}"


def shown_path(given: Path) -> Path:
    """Return a path as the user typed it: of ``s3://`` a `Path` drops a slash."""
    return TreePath(given) if S3.fullmatch(os.fspath(given)) else given


def is_table(given: str | os.PathLike[str]) -> bool:
    """Return True if a path is a published tree; every ``s3://`` URL is one."""
    text = os.fspath(given)
    if S3.fullmatch(text):
        return True
    try:
        return any(name.startswith("line=") for name in os.listdir(f"{text}/{RUNS}"))  # noqa: PTH208  # of many lines
    except (OSError, ValueError):
        return False


def is_published(given: Path) -> bool:
    """Return True if a path is ``TABLE/RUN``; False for a folder that exists."""
    return bool(RUN_NAME.fullmatch(given.name)) and not given.is_dir() and is_table(given.parent)


def find_published(tree: Tree, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
    """Yield the published runs that match, as `find_runs.find` does for a folder."""
    annotated = tree.below(ANNOTATIONS.partition(".")[0])

    def summary(run: str) -> Found | Unreadable | None:
        data = tree.read(key_of(run, MANIFEST)) or b""
        key = key_of(run, ANNOTATIONS)

        def late() -> list[str]:
            lines = (tree.read(key) if key in annotated else None) or b""
            return late_in(annotations_in(lines, sha256(data)))

        return summary_in(data, tree.path / run, wanted, late, has_annotations=key in annotated)

    names = [run for run in tree.runs() if wanted.may_have(Path(run))]
    from concurrent.futures import ThreadPoolExecutor  # finding runs in folders is light

    with ThreadPoolExecutor(THREADS) as threads:
        for found in threads.map(summary, names):
            if isinstance(found, Unreadable) or (found is not None and wanted.fits(found)):
                yield found


def find_in(folder: Path, wanted: Filter = ALL) -> Iterator[Found | Unreadable]:
    """Yield the matching runs in a folder or in a published tree. Raises `RecordError`."""
    if is_table(folder):
        return find_published(Tree.at(folder), wanted)
    return find(folder, wanted)


def fetch(tree: Tree, run: str, home: Path, wanted: Callable[[str], bool]) -> Path:
    """Copy the files of a published run that are `wanted`, and its manifest, to ``home/RUN``;
    return that folder. Raises `RecordError`.
    """
    folder = home / run
    folder.mkdir()
    if not _fetch_file(tree, key_of(run, MANIFEST), folder / MANIFEST):
        raise RecordError(f"{tree}/{run}: is not published there; `jbclog runs {tree}` lists runs")
    try:
        listed = [file.path for file in read_manifest(folder).files]
    except RecordError as error:
        raise RecordError(str(error).replace(str(home), str(tree))) from error
    for name in filter(wanted, (*listed, ANNOTATIONS, *MADE_LATER)):
        there = _fetch_file(tree, key_of(run, name), folder / name)
        if not there and name in listed:
            raise RecordError(
                f"{tree}/{key_of(run, name)} is missing; `jbclog publish` of the run's folder"
                " copies it again"
            )
    return folder


def _fetch_file(tree: Tree, key: str, path: Path) -> bool:
    """Copy a file out of a tree; return whether it exists."""
    with explained(tree), suppress(FileNotFoundError), tree.files().open_input_file(key) as source:
        path.parent.mkdir(exist_ok=True)
        with path.open("xb") as file:
            shutil.copyfileobj(source, file, MIB)
        return True
    return False


@contextmanager
def whole_run(path: Path) -> Iterator[Path]:
    """Yield the folder of a run: `path` itself, or a copy of the published run for as long as the
    context lasts. Raises `RecordError`.
    """
    if not is_published(path):
        yield path
        return
    from tempfile import TemporaryDirectory

    with TemporaryDirectory(prefix="jbclog-") as home:
        yield fetch(
            Tree.at(path.parent), path.name, Path(home), lambda name: name not in MADE_LATER
        )
