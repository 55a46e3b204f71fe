"""The place of a store: a folder, a network share or ``s3://BUCKET/PATH``. Opens its tables and
files; loads Arrow only then, because finding runs in folders does not need it.

Access to tables and to S3 goes through the `deltalake` library, which takes credentials from the
environment. Its errors can repeat a server's answer; they are shown as one line without secrets.
"""

from __future__ import annotations

import os
import re
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path, PosixPath, PurePosixPath
from typing import TYPE_CHECKING, Final
from urllib.parse import unquote

from jbclog.analysis.store.checkpoints import expect_bounded
from jbclog.analysis.store.endpoint import CREDENTIALS, expect_list
from jbclog.analysis.store.plain_files import plain_files
from jbclog.core.errors import StoreError, UsageError
from jbclog.core.files import (
    Kind,
    NotReadable,
    expect_regular,
    is_plain_folder,
)
from jbclog.core.text import clean, shortened
from jbclog.record.folder import RUN_NAME

if TYPE_CHECKING:
    import pyarrow.fs as pf
    from deltalake import DeltaTable

S3: Final = re.compile(r"s3a?:/+(.+)", re.DOTALL)  # a `Path` drops one of the two slashes
URL: Final = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*):/")
OPTIONS: Final = {
    "conditional_put": "etag",
    "max_retries": "3",
    "retry_timeout": "20s",
    "timeout": "30s",
}
"""Options of the library for S3. Commits use conditional writes only, whatever the environment
says. A lost server is an error, not a long wait. `timeout` limits one request, from its connection
to the end of its answer; the library limits neither the bytes of an answer nor the pages of a list.
"""
TIMEOUT: Final = "AWS_TIMEOUT"  # the user may set it for a slow server
UNSAFE: Final = "AWS_S3_ALLOW_UNSAFE_RENAME"
SECRETS: Final = ("AWS_SECRET_ACCESS_KEY", "AWS_SESSION_TOKEN", "AWS_ACCESS_KEY_ID")
NOT_INSTALLED: Final = "{}: `pip install 'jbclog[plant]'` installs the packages for stores"
REFUSED: Final = re.compile(
    r"169\.254\.|InvalidAccessKeyId|SignatureDoesNotMatch|AccessDenied|ExpiredToken|InvalidToken"
    r"|403 "
)
LOG: Final = "_delta_log"
HINT: Final = "_last_checkpoint"
MOST_SAID: Final = 400  # characters of an error's text
MARKS: Final = re.compile(r"\x1b\[[0-9;]*m|↳")
CODE: Final = re.compile(r"<Code>([^<]*)</Code>")
MESSAGE: Final = re.compile(r"<Message>([^<]*)</Message>")


class StorePath(PosixPath):
    """A place in a store, as a path. Its text has both slashes of ``s3://``, of which a path drops
    one.
    """

    def __str__(self) -> str:
        return re.sub(r"^s3a?:/+", "s3://", super().__str__())


@dataclass(frozen=True, slots=True)
class FileThere:
    """A file in a store: its name relative to the store, its size in bytes, and the time of its
    last write by the storage's clock.
    """

    name: str
    size: int
    written: datetime | None


@dataclass(frozen=True, slots=True)
class Place:
    """The place of a store: an absolute path, or ``s3://BUCKET/PATH``."""

    url: str

    @property
    def is_remote(self) -> bool:
        return S3.match(self.url) is not None

    @property
    def path(self) -> StorePath:
        return StorePath(self.url)

    @property
    def options(self) -> dict[str, str] | None:
        return options_of_s3() if self.is_remote else None

    def __str__(self) -> str:
        return self.url

    def expect_answer(self) -> None:
        """Raise `StoreError` if the store's server does not answer. A folder has no server."""
        with explained(self.url):
            pass

    def of(self, name: str) -> str:
        """Return the path or URL of a table or file in the store."""
        return f"{self.url.rstrip('/')}/{name}"

    def table(self, name: str) -> DeltaTable:
        """Open the newest version of a table. Raises `StoreError`."""
        from deltalake import DeltaTable
        from deltalake.exceptions import TableNotFoundError

        self._expect_plain_log(name)
        with explained(self.url):
            try:
                return DeltaTable(self.of(name), storage_options=self.options)
            except TableNotFoundError:
                raise StoreError(
                    f"{self.url}: its table {name} is missing; this is no store, or a damaged one"
                ) from None

    def has_table(self, name: str) -> bool:
        """Return True if the store has a table of that name. Raises `StoreError`."""
        from deltalake import DeltaTable

        self._expect_plain_log(name)
        with explained(self.url):
            return DeltaTable.is_deltatable(self.of(name), storage_options=self.options)

    # The library opens a pipe and waits without end, and no signal interrupts it. It reads a hint
    # of any size, and follows links: its vacuum deletes their targets. So jbclog checks a folder
    # first. S3 has neither pipes nor links.

    def _expect_plain_log(self, name: str) -> None:
        if self.is_remote:
            return
        with explained(self.url):
            paths = [*self._plain_files(f"{name}/{LOG}")]
            for path in paths:
                with suppress(FileNotFoundError):  # a draft of a commit, renamed meanwhile
                    expect_regular(
                        path, Kind.CHECKPOINT_HINT if path.name == HINT else Kind.STORE_LOG
                    )
            expect_bounded(paths)

    def expect_plain(self, name: str) -> None:
        """Raise `StoreError` if a table contains anything but regular files and folders."""
        if not self.is_remote:
            with explained(self.url):
                deque(self._plain_files(name), maxlen=0)

    def _plain_files(self, name: str) -> Iterator[Path]:
        """Yield the files below a folder of the store. Raises `NotReadable` for links and special
        files, also if a folder above it is one.
        """
        for above in (Path(self.of(str(one))) for one in [*PurePosixPath(name).parents][:-1]):
            if os.path.lexists(above) and not is_plain_folder(above):
                raise NotReadable(f"{above}: is not a folder of its own")
        yield from plain_files(Path(self.of(name)))

    def expect_below(self, name: str, paths: Iterable[str]) -> None:
        """Raise `StoreError` if a path in a table's log leads out of the table."""
        outside = next((path for path in paths if ".." in unquote(path).split("/")), None)
        if outside is not None:
            with explained(self.url):
                raise NotReadable(f"{name}: its log names a file elsewhere, {outside}")

    def expect_files(self, name: str, paths: Sequence[str]) -> None:
        """Raise `StoreError` unless each of these paths in a table's log is a regular file in the
        table.
        """
        self.expect_below(name, paths)
        if not self.is_remote:
            with explained(self.url):
                for path in paths:
                    expect_regular(Path(self.of(name), path), Kind.PART)

    def files(self) -> pf.FileSystem:
        """Return the store as a file system; names are relative to the store."""
        import pyarrow.fs as pf

        if self.is_remote:
            from deltalake.fs import DeltaStorageHandler

            return pf.PyFileSystem(DeltaStorageHandler(self.url, self.options))
        return pf.SubTreeFileSystem(self.url, pf.LocalFileSystem())

    def listed(self, folder: str) -> list[FileThere]:
        """Return all files below a folder of the store; none without it. Raises `StoreError`."""
        import pyarrow.fs as pf

        with explained(self.url):
            found = self.files().get_file_info(
                pf.FileSelector(folder, allow_not_found=True, recursive=True)
            )
        return [
            FileThere(one.path, one.size, one.mtime)
            for one in found
            if one.type == pf.FileType.File
        ]

    def remove(self, name: str) -> None:
        """Remove a folder of the store, or a file directly in it; ignores a missing one. Raises
        `StoreError`.
        """
        import pyarrow.fs as pf

        path = Path(self.of(name))
        if not self.is_remote and "/" not in name and not is_plain_folder(path):
            with explained(self.url):
                path.unlink(missing_ok=True)
            return
        self.expect_plain(name)
        with explained(self.url):
            files = self.files()
            if files.get_file_info(pf.FileSelector(name, allow_not_found=True)):
                files.delete_dir(name)


def options_of_s3() -> dict[str, str]:
    """Return the library's options for S3, with the time limit of the environment."""
    return OPTIONS | {"timeout": os.environ.get(TIMEOUT) or OPTIONS["timeout"]}


def place_of(given: str | os.PathLike[str]) -> Place:
    """Return the place that a user names. Raises `UsageError` for another kind of URL, for one with
    credentials, and if the environment allows unsafe commits.
    """
    text = os.fspath(given)
    remote = S3.fullmatch(text)
    if remote is not None:
        if "@" in remote[1].partition("/")[0]:
            raise UsageError(f"s3://…: a URL must not contain credentials{CREDENTIALS}")
        if os.environ.get(UNSAFE, "").lower() in ("1", "true", "yes", "on"):
            raise UsageError(
                f"{UNSAFE} is set: two publishers could overwrite each other's commits; unset it"
            )
        return Place(f"s3://{remote[1].rstrip('/')}")
    if URL.match(text):
        raise UsageError(
            f"{shortened(clean(text), MOST_SAID)}: a store must be a folder or s3://BUCKET/PATH"
        )
    return Place(os.path.abspath(text))  # noqa: PTH100  # `resolve` would follow the user's links


def is_store(given: str | os.PathLike[str]) -> bool:
    """Return True if a user's path is a store. True for every ``s3://`` URL: jbclog keeps nothing
    else there.
    """
    text = os.fspath(given)
    if S3.fullmatch(text):
        return True
    try:
        return Path(text, "runs", LOG).is_dir()
    except (OSError, ValueError):
        return False


def is_in_store(given: Path) -> bool:
    """Return True if a user's path is ``STORE/RUN``; False for a folder that exists."""
    return bool(RUN_NAME.fullmatch(given.name)) and not given.is_dir() and is_store(given.parent)


def expect_library() -> None:
    """Raise `UsageError` with the command that installs `deltalake` if it is missing."""
    try:
        import deltalake  # noqa: F401
    except ModuleNotFoundError as error:
        raise UsageError(NOT_INSTALLED.format(error)) from None


@contextmanager
def explained(url: str) -> Iterator[None]:
    """Turn errors of the library into a `StoreError` of one line. Raises one as well if the store's
    server does not answer.
    """
    from deltalake.exceptions import DeltaError
    from pyarrow import ArrowException

    try:
        if S3.match(url):
            expect_list(url, options_of_s3())
        yield
    except (DeltaError, OSError, ArrowException, ValueError) as error:
        text = one_line(error)
        raise StoreError(
            f"{url}: {text}{CREDENTIALS if REFUSED.search(text) and S3.match(url) else ''}"
        ) from error


def one_line(error: BaseException) -> str:
    """Return the text of an error on one line, without colours and secrets; of a server's XML
    answer only code and message.
    """
    plain = MARKS.sub("", str(error))
    before, xml, answer = plain.partition("<?xml")
    code, message = CODE.search(answer), MESSAGE.search(answer)
    reported = " ".join(found[1] for found in (code, message) if found) if xml else ""
    text = " ".join(f"{before} {reported}".split()) or type(error).__name__
    for secret in filter(None, (os.environ.get(name) for name in SECRETS)):
        text = text.replace(secret, "***")
    return shortened(clean(text), MOST_SAID)
