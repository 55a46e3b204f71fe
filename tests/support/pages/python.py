"""docs/reference/python.md: the public names of `jbclog`, `jbclog.live` and `jbclog.spc`, their
signatures and docstrings.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from enum import Enum
from types import ModuleType

import jbclog
import jbclog.live
import jbclog.spc
from support.pages.md_table import MADE

INTRODUCTION = """
`import jbclog` is light: pandas and matplotlib load when something first needs them. Everything else below `jbclog` may change with
any release. [Tables and columns](tables.md) has the columns of the DataFrames.
"""

WIDTH = 110


def page() -> str:
    """The whole page."""
    parts = [
        f"{MADE}\n\n# Python\n{INTRODUCTION}",
        *_module(jbclog),
        f"## jbclog.live\n\n{inspect.getdoc(jbclog.live)}",
        *_module(jbclog.live),
        f"## jbclog.spc\n\n{inspect.getdoc(jbclog.spc)}",
        *_module(jbclog.spc),
    ]
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _module(module: ModuleType) -> Iterable[str]:
    level = "##" if module is jbclog else "###"
    for name in sorted(
        module.__all__, key=lambda one: (inspect.isclass(getattr(module, one)), one)
    ):
        thing = getattr(module, name)
        if inspect.isclass(thing) or inspect.isfunction(thing):
            yield f"{level} {name}\n\n{_signature(name, thing)}{_text(thing)}{_values(thing)}"
            if inspect.isclass(thing) and (module is jbclog or thing is jbclog.live.Follower):
                yield from _members(thing, f"{level}#")


def _members(one: type, level: str) -> Iterable[str]:
    inherited = [
        vars(base) for base in reversed(one.__mro__) if base.__module__.startswith("jbclog")
    ]
    for name, member in {
        name: member for names in inherited for name, member in names.items()
    }.items():
        if name.startswith("_"):
            continue
        if isinstance(member, property):
            yield f"{level} {one.__name__}.{name}\n\n{_text(member)}"
        elif inspect.isfunction(member) or isinstance(member, staticmethod):
            yield (
                f"{level}"
                f" {one.__name__}.{name}\n\n{_signature(name, getattr(one, name))}{_text(member)}"
            )


def _signature(name: str, thing: object) -> str:
    """Without the types' quotes; a class that only errors or jbclog make has none."""
    if inspect.isclass(thing) and (
        issubclass(thing, Exception | Enum) or thing in (jbclog.PortData, jbclog.Run, jbclog.Runs)
    ):
        return ""
    assert callable(thing)
    parameters = list(_parameters(inspect.signature(thing)))
    given = inspect.signature(thing).return_annotation
    back = (
        ""
        if given is inspect.Signature.empty or inspect.isclass(thing)
        else f" -> {given}".replace("'", "")
    )
    line = f"{name}({', '.join(parameters)}){back}"
    if len(line) > WIDTH:
        line = f"{name}(\n    " + ",\n    ".join(parameters) + f",\n){back}"
    return f"```text\n{line}\n```\n\n"


def _parameters(signature: inspect.Signature) -> Iterable[str]:
    is_marked = False
    for one in signature.parameters.values():
        if one.kind is one.KEYWORD_ONLY and not is_marked:
            is_marked = True
            yield "*"
        if one.name != "self":
            yield re.sub(r": '([^']*)'", r": \1", str(one))


def _values(thing: object) -> str:
    """The values of an enum."""
    is_enum = inspect.isclass(thing) and issubclass(thing, Enum)
    return f"\n\nOne of {', '.join(f'`{one.value}`' for one in thing)}." if is_enum else ""  # type: ignore[attr-defined]


def _text(thing: object) -> str:
    return (inspect.getdoc(thing) or "").strip()
