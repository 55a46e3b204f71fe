"""A file that may be anybody's is opened in one place (`jbclog/core/foreign`): a bare read anywhere
else is found here, and a write into what may stand there: a pipe, or a link to another file.

Ruff's banned-api knows names of modules and not methods such as `Path.read_bytes`, so this looks at
the syntax tree itself.
"""

from __future__ import annotations

import ast
import functools
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import jbclog
from support.readers.repository import parsed

PACKAGE = Path(jbclog.__file__).parent
HOME = ("core", "foreign")

READS = {"read_bytes", "read_text"}  # methods of a path
# in Python 3.11 it raises RuntimeError where a link leads to itself; os.path.realpath does not
LOOPS = {"resolve"}
FUNCTIONS = {
    *(
        "ParquetFile",
        "ParquetDataset",
        "read_table",
        "read_schema",
        "read_metadata",
        "read_parquet",
        "read_csv",
        "read_feather",
        "open_csv",
        "make_fragment",
    ),
    *("memory_map", "mmap", "memmap", "fromfile", "loadtxt", "genfromtxt", "open_memmap"),
    *("OSFile", "FileIO", "input_stream", "open_input_file", "open_input_stream"),
    *("ZipFile", "TarFile", "GzipFile", "LZMAFile", "BZ2File", "DeltaTable", "Connection"),
    *("getline", "getlines", "run_path", "fileinput", "copy2", "copytree", "copyfile", "copy_file"),
}
MODULES = {
    *("sqlite3", "io", "codecs", "gzip", "bz2", "lzma", "zipfile", "tarfile", "wave", "shelve"),
    *("dbm", "tokenize", "dbapi2"),
}
"""Modules whose `open` or `connect` takes a path."""
LOADERS = {"json", "tomllib", "pickle", "np", "numpy", "marshal", "shelve", "plistlib", "yaml"}
"""Modules whose `load` takes a file or a path."""
KNOWN_OPENS = ("port", "opened", "server", "self")
WHOLE_NAMES = {"shutil.copy", "shutil.copyfileobj", "ds.dataset", "pa.dataset.dataset"}

ALLOWED = {
    "cli/demo.py:read_text": "files of this package",
    "app/watch/server.py:read_bytes": "files of this package",
    "report/joints.py:ParquetFile": "bytes that it has just written",
    "report/page.py:read_text": "files of this package",
    "report/page.py:read_bytes": "files of this package",
    "report/typeset.py:read_bytes": "fonts of this package",
    "cli/streams.py:open": "the three streams by their numbers, and the null device",
    "cli/streams.py:os.open": "the null device",
    "guard/action_log.py:os.open": "the null device",
    "app/doctor.py:read_text": "the kernel's own, below /sys",
    "transport/system_ports.py:read_text": "the kernel's own, below /proc",
    "core/locks.py:read_text": "the kernel's own, below /proc",
    "guard/lease.py:os.open": "its `FLAGS` make a new file",
    "transport/typed_lines.py:os.open": "a source of units, as below",
    "transport/typed_lines.py:open": (
        "a source of units, which is a pipe or a device by its nature; it is polled"
    ),
    "core/durable_files.py:os.open": (
        "what was just written, to sync it; to add a line, looked at by `expect_opened`"
    ),
    "sim/links.py:os.open": "a pseudo terminal of a virtual station",
    "record/published.py:open_input_file": "a file of a published tree, through pyarrow",
    "record/published.py:shutil.copyfileobj": "the same",
    "analysis/published_run.py:open_input_file": "the same",
    "analysis/published_run.py:ParquetFile": "the same",
    "analysis/published_run.py:open": "the same",
    "app/publish.py:open": "the same",
    "config/load_recipe.py:read_text": (
        "the function of `core/foreign/toml_reader.py`, which reads through `read_foreign`"
    ),
    "record/folder.py:read_text": "the same",
    "config/line.py:read_text": "the same",
    "config/tasks_file.py:read_text": "the same",
    "config/jobs_file.py:read_text": "the same",
    "config/line.py:read_table": "a table of TOML",
    "config/schema.py:read_table": "a table of TOML",
    "config/load_recipe.py:read_table": "a table of TOML",
    "config/jobs_file.py:read_table": "a table of TOML",
}
"""File and call -> why it is no read of a foreign file."""

WRITES = {"write_bytes", "write_text", "touch"}
WRITTEN = {
    "app/export/csv_files.py:write_text": "a folder that it has just made",
    "app/run/metrics_cache.py:write_bytes": "the kernel's own, below /proc",
    "cli/demo.py:write_text": "a folder that it has just made",
    "cli/scan.py:write_text": "a file that the user names",
    "cli/streams.py:open": "the three streams by their numbers",
    "cli/trend.py:write_text": "a file that the user names",
    "record/store.py:write_bytes": "the folder that its recorder has just made",
    "sim/serve.py:open": "a file that the user names",
    "sim/setup.py:write_text": "looked at by `_expect_place` before",
}
"""File and call -> why nobody else can have put something there."""


def bare_reads(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of each place in a file that reads from what may be anybody's."""
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call) and (name := _read(node)) is not None:
            yield node.lineno, name
        elif isinstance(node, ast.Attribute) and node.attr in READS:
            yield node.lineno, node.attr  # also one that is not called: map(Path.read_bytes, paths)
        elif isinstance(node, ast.ImportFrom):
            yield from (
                (node.lineno, f"{node.module}.{one.name}")
                for one in node.names
                if _is_of_module(node.module or "", one.name)
            )


def _read(call: ast.Call) -> str | None:
    whole = ast.unparse(call.func)
    before, _, last = whole.rpartition(".")
    if whole in WHOLE_NAMES or _is_of_module(before, last):
        return whole
    if last in FUNCTIONS or whole in READS or (last in LOOPS and not call.args):
        return last
    if last.startswith("read_") and before in ("pd", "pandas"):
        return whole
    if whole == "os.open":
        return None if _is_no_read(call) else whole
    return "open" if _is_open(call, before, last) and not _writes(call) else None


def _is_of_module(before: str, last: str) -> bool:
    module = before.rpartition(".")[2]
    return (last in ("open", "connect") and module in MODULES) or (
        last == "load" and module in LOADERS
    )


def _is_no_read(call: ast.Call) -> bool:
    """Whether `os.open` makes a file, or opens a folder."""
    flags = ast.unparse(call)
    return any(flag in flags for flag in ("O_CREAT", "O_DIRECTORY"))


def _is_open(call: ast.Call, before: str, last: str) -> bool:
    """Whether it opens a file. The `open` of a port, a store or a collection of runs has no mode
    and no name of `KNOWN_OPENS`.
    """
    if last != "open":
        return False
    if call.args:
        return before in ("", "Path", "pathlib.Path") or _is_mode(call.args[0])
    return bool(call.keywords) or before not in KNOWN_OPENS


def _is_mode(argument: ast.expr) -> bool:
    return (
        isinstance(argument, ast.Constant)
        and isinstance(argument.value, str)
        and set(argument.value) <= set("rwxab+t")
    )


def _writes(call: ast.Call, how: str = "wxa") -> bool:
    place = 1 if ast.unparse(call.func) == "open" else 0
    mode = call.args[place] if len(call.args) > place else None
    return (
        isinstance(mode, ast.Constant)
        and isinstance(mode.value, str)
        and set(mode.value) & set(how) != set()
    )


def bare_writes(path: Path) -> Iterator[tuple[int, str]]:
    """Line and name of each place in a file that writes to a name which may be taken. Mode ``x``
    makes a new file.
    """
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Attribute) and node.attr in WRITES:
            yield node.lineno, node.attr
        elif isinstance(node, ast.Call):
            before, _, last = ast.unparse(node.func).rpartition(".")
            if _is_open(node, before, last) and _writes(node, "wa"):
                yield node.lineno, "open"


@functools.cache
def found_below(
    package: Path, bare: Callable[[Path], Iterator[tuple[int, str]]] = bare_reads
) -> dict[str, str]:
    """``FILE:CALL`` of each read or write outside of the one room, and where it stands."""
    files = (
        path
        for path in sorted(package.rglob("*.py"))
        if path.relative_to(package).parts[:2] != HOME
    )
    return {
        f"{path.relative_to(package).as_posix()}:{name}": (
            f"{path.relative_to(package).as_posix()}:{line}"
        )
        for path in files
        for line, name in bare(path)
    }


def test_nothing_is_read_but_through_the_one_room() -> None:
    found = found_below(PACKAGE)
    assert {place for call, place in found.items() if call not in ALLOWED} == set(), (
        "use jbclog.core.foreign"
    )


def test_nothing_is_written_to_what_may_stand_there() -> None:
    found = found_below(PACKAGE, bare_writes)
    assert {place for call, place in found.items() if call not in WRITTEN} == set(), (
        "use open_to_write, or write_whole of jbclog.core.durable_files"
    )


def test_every_exception_is_still_one() -> None:
    for allowed, bare in ((ALLOWED, bare_reads), (WRITTEN, bare_writes)):
        found = found_below(PACKAGE, bare)
        assert {call for call in allowed if call not in found} == set()


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("(folder / NAME).open('ab')", "open"),
        ("path.open('w', encoding='ascii')", "open"),
        ("open(path, 'w')", "open"),
        ("path.write_text('')", "write_text"),
        ("[*map(Path.touch, paths)]", "touch"),
        ("path.open('xb')", None),
        ("path.open('rb')", None),
        ("os.fdopen(open_to_write(path, kind), 'ab')", None),
    ],
)
def test_a_bare_write_is_found(tmp_path: Path, text: str, name: str | None) -> None:
    path = tmp_path / "record" / "made_up.py"
    path.parent.mkdir()
    path.write_text(f"x = {text}\n", encoding="utf-8")
    found = list(found_below(tmp_path, bare_writes))
    assert found == ([f"record/made_up.py:{name}"] if name else [])


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("path.read_bytes()", "read_bytes"),
        ("(folder / NAME).read_text(encoding='utf-8')", "read_text"),
        ("open(path)", "open"),
        ("open(path, 'rb')", "open"),
        ("path.open('rb')", "open"),
        ("path.open('r+b')", "open"),
        ("path.open(encoding='utf-8')", "open"),
        ("os.open(path, os.O_RDONLY)", "os.open"),
        ("pq.ParquetFile(path)", "ParquetFile"),
        ("pq.read_table(path)", "read_table"),
        ("pq.read_metadata(path)", "read_metadata"),
        ("pd.read_parquet(path)", "read_parquet"),
        ("sqlite3.connect(path)", "sqlite3.connect"),
        ("mmap.mmap(file.fileno(), 0)", "mmap"),
        ("np.fromfile(path)", "fromfile"),
        ("json.load(file)", "json.load"),
        ("path.open()", "open"),
        ("(folder / NAME).open(buffering=0)", "open"),
        ("Path.open(path)", "open"),
        ("io.open(path)", "io.open"),
        ("gzip.open(path)", "gzip.open"),
        ("tarfile.open(path)", "tarfile.open"),
        ("zipfile.ZipFile(path)", "ZipFile"),
        ("list(map(Path.read_bytes, paths))", "read_bytes"),
        ("np.load(path)", "np.load"),
        ("np.memmap(path)", "memmap"),
        ("pa.memory_map(path)", "memory_map"),
        ("pa.input_stream(path)", "input_stream"),
        ("pd.read_excel(path)", "pd.read_excel"),
        ("ds.dataset(path)", "ds.dataset"),
        ("DeltaTable(path)", "DeltaTable"),
        ("shutil.copytree(path, other)", "copytree"),
        ("path.open('wb')", None),
        ("path.open('x')", None),
        ("os.open(path, os.O_RDWR | os.O_CREAT)", None),
        ("read_foreign(path, Kind.MANIFEST)", None),
        ("path.resolve()", "resolve"),
        ("os.path.realpath(path)", None),
        ("port.open()", None),
        ("Segment.open(path)", None),
    ],
)
def test_a_bare_read_is_found(tmp_path: Path, text: str, name: str | None) -> None:
    path = tmp_path / "record" / "made_up.py"
    path.parent.mkdir()
    path.write_text(f"x = {text}\n", encoding="utf-8")
    assert list(found_below(tmp_path)) == ([f"record/made_up.py:{name}"] if name else [])


def test_an_imported_name_is_found(tmp_path: Path) -> None:
    (tmp_path / "a.py").write_text("from sqlite3 import connect\nfrom json import dumps, load\n")
    assert [*found_below(tmp_path)] == ["a.py:sqlite3.connect", "a.py:json.load"]
