"""jbclog on a desk that has nothing of POSIX, as far as Linux can show it: modules are blocked, and
names that Windows lacks are removed from the modules that jbclog imports.

Run as a program it makes calls, one after another, in a process of its own: JSON of `Call` in,
JSON of `Done` out. What a system has is read from typeshed, which mypy brings along.
"""

from __future__ import annotations

import ast
import builtins
import contextlib
import errno
import fcntl
import importlib
import importlib.util
import io
import json
import os
import struct
import subprocess
import sys
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path, PureWindowsPath
from types import ModuleType, SimpleNamespace
from typing import Any, Final

BLOCKED: Final = ("fcntl", "termios", "resource", "pwd", "grp", "pty", "tty")
PARTIAL: Final = ("os", "select", "signal", "socket", "time")
FOLDERS: Final = ("/proc", "/sys/", "/dev/fd")
TESTS: Final = Path(__file__).parents[2]
TIMEOUT_S: Final = 280


# -- what another system lacks ---------------------------------------------------------------------


@cache
def lacking(module: str) -> frozenset[str]:
    """The names of a module of the standard library that Linux has and Windows has not."""
    return _names(module, "linux") - _names(module, "win32")


def _names(module: str, platform: str) -> frozenset[str]:
    found = importlib.util.find_spec("mypy")
    assert found is not None
    assert found.origin is not None
    home = Path(found.origin).parent / "typeshed" / "stdlib"
    packed, plain = home / module / "__init__.pyi", home / f"{module}.pyi"
    stub = packed if packed.exists() else plain
    tree = ast.parse(stub.read_text("utf-8"))
    names = frozenset(_defined(tree.body, platform))
    imported = _names(f"_{module}", platform) if module in ("socket",) else frozenset()
    return names | imported


def _defined(statements: Sequence[ast.stmt], platform: str) -> Iterator[str]:
    system = SimpleNamespace(platform=platform, version_info=sys.version_info)
    for statement in statements:
        if isinstance(statement, ast.If):
            code = compile(ast.Expression(statement.test), "stub", "eval")
            is_so = eval(code, {"sys": system, "TYPE_CHECKING": True})
            yield from _defined(statement.body if is_so else statement.orelse, platform)
        elif isinstance(statement, ast.FunctionDef | ast.ClassDef):
            yield statement.name
            if isinstance(statement, ast.ClassDef) and module_constants(statement):
                yield from _defined(statement.body, platform)
        elif isinstance(statement, ast.AnnAssign) and isinstance(statement.target, ast.Name):
            yield statement.target.id
        elif isinstance(statement, ast.Assign):
            yield from (target.id for target in statement.targets if isinstance(target, ast.Name))
        elif isinstance(statement, ast.ImportFrom):
            yield from (name.asname or name.name for name in statement.names)


def module_constants(found: ast.ClassDef) -> bool:
    """Whether the members of an enumeration are names of the module too, as those of signals."""
    return any(isinstance(base, ast.Name) and base.id == "IntEnum" for base in found.bases)


class Locks(ModuleType):
    """`msvcrt`, as far as jbclog uses it: locks of bytes at the file's position."""

    LK_NBLCK = 2

    def locking(self, descriptor: int, mode: int, count: int) -> None:
        assert mode == self.LK_NBLCK
        at = os.lseek(descriptor, 0, os.SEEK_CUR)
        can_write = fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE != os.O_RDONLY
        kind = fcntl.F_WRLCK if can_write else fcntl.F_RDLCK
        wanted = struct.pack("hhqqi4x", kind, os.SEEK_SET, at, count, 0)
        try:
            fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, wanted)
        except OSError:
            raise PermissionError(errno.EACCES, "Permission denied") from None


def install() -> None:
    """Take POSIX away from this process, before it imports jbclog."""
    facades = {name: _without(importlib.import_module(name), lacking(name)) for name in PARTIAL}
    sys.modules.update(dict.fromkeys(BLOCKED))  # type: ignore[arg-type]  # None: cannot be imported
    sys.modules["msvcrt"] = Locks("msvcrt")
    really = builtins.__import__

    def importing(
        name: str,
        globals: Mapping[str, object] | None = None,  # noqa: A002  # as Python names it
        locals: Mapping[str, object] | None = None,  # noqa: A002
        fromlist: Sequence[str] | None = (),
        level: int = 0,
    ) -> ModuleType:
        module = really(name, globals, locals, fromlist or (), level)
        is_ours = str((globals or {}).get("__name__")).partition(".")[0] == "jbclog"
        return facades.get(module.__name__, module) if is_ours else module

    builtins.__import__ = importing  # type: ignore[assignment]
    sys.addaudithook(_refuse)


def _without(module: ModuleType, names: frozenset[str]) -> ModuleType:
    facade = ModuleType(module.__name__)
    facade.__dict__.update({key: it for key, it in vars(module).items() if key not in names})
    return facade


def _refuse(event: str, arguments: tuple[Any, ...]) -> None:
    """Refuse folders that Linux alone has, and names of files that Windows does not allow."""
    if event not in ("open", "os.listdir", "os.scandir", "os.mkdir", "os.rename"):
        return
    for path in arguments[: 2 if event == "os.rename" else 1]:
        if not isinstance(path, str | bytes | os.PathLike):
            continue
        text = os.fsdecode(path)
        if text.startswith(FOLDERS):
            raise FileNotFoundError(errno.ENOENT, "this system has no such folder", text)
        if forbidden_name(Path(text)) is not None:
            raise OSError(errno.EINVAL, "this system allows no such name", text)


def forbidden_name(path: Path) -> str | None:
    """The first part of a path that Windows does not allow as a name."""
    for part in path.parts:
        if part == "/":
            continue
        has_sign = any(sign in '<>:"\\|?*' or sign < " " for sign in part)
        is_trimmed = part not in (".", "..") and part.endswith((".", " "))
        if has_sign or is_trimmed or PureWindowsPath(part).is_reserved():
            return part
    return None


# -- calls -----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Call:
    """Words of a command, or else code, or else a notebook, with variables of the environment."""

    words: tuple[str, ...] = ()
    code: str = ""
    notebook: str = ""
    environment: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class Done:
    """The exit code, and what was printed."""

    code: int
    out: str
    err: str


def made_elsewhere(calls: Sequence[Call], folder: Path) -> list[Done]:
    """Make the calls in `folder`, in one process without POSIX."""
    done = subprocess.run(
        [sys.executable, "-P", str(Path(__file__)), str(folder)],
        input=json.dumps([asdict(call) for call in calls]),
        env={**os.environ, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stderr
    return [Done(**each) for each in json.loads(done.stdout)]


def _make(call: Call) -> Done:
    out, err = io.StringIO(), io.StringIO()
    code: object = 0
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            if call.words:
                sys.argv = ["jbclog", *call.words]
                importlib.import_module("jbclog.cli.app").main()
            elif call.code:
                exec(compile(call.code, "call", "exec"), {"__name__": "jbclog.called"})
            else:
                os.environ.update(dict(call.environment))
                importlib.import_module("support.readers.notebook_runs").run_here(
                    Path(call.notebook)
                )
        except SystemExit as end:
            code = end.code
        except Exception:
            traceback.print_exc(file=err)
            code = -1
    return Done(code if isinstance(code, int) else 0, out.getvalue(), err.getvalue())


def main() -> None:
    sys.path.insert(0, str(TESTS))
    os.chdir(sys.argv[1])
    calls = [Call(**each) for each in json.load(sys.stdin)]
    install()
    answer = json.dumps([asdict(_make(call)) for call in calls])
    sys.__stdout__.write(answer)  # type: ignore[union-attr]


if __name__ == "__main__":
    main()
