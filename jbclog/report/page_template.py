"""The template engine of the two pages: a run's and an audit's.

Compiled templates are kept where Python keeps compiled modules, because compiling them takes a
fifteenth of a short run's report. A user who may not write there compiles them each time.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import metadata
from importlib.util import cache_from_source
from pathlib import Path
from typing import Final

from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket

from jbclog import __version__
from jbclog.core.text import number, stamp, together

ENGINE: Final = partial(
    Environment,
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def environment(package: str, finalize: Callable[[object], object] | None = None) -> Environment:
    """Return the engine of the templates in `package`, which escapes all text and refuses unknown
    names. `finalize` is applied to every value before it is written.
    """
    made = ENGINE(loader=PackageLoader(package), finalize=finalize, bytecode_cache=_Compiled())
    made.filters.update(number=number, stamp=stamp, together=together)
    return made


class _Compiled(FileSystemBytecodeCache):
    """The compiled templates. Those of another text, another version or other settings are not
    used.
    """

    def __init__(self) -> None:
        super().__init__(str(Path(cache_from_source(__file__)).parent), "%s.template")
        self._by = f"{__version__} {metadata.version('jinja2')} {ENGINE.keywords}"

    def get_source_checksum(self, source: str) -> str:
        return super().get_source_checksum(f"{self._by}\n{source}")

    def load_bytecode(self, bucket: Bucket) -> None:
        try:
            super().load_bytecode(bucket)
        except Exception:  # after a crash the file may be incomplete, which can raise anything
            bucket.reset()

    def dump_bytecode(self, bucket: Bucket) -> None:
        with suppress(OSError):
            if not sys.dont_write_bytecode:
                super().dump_bytecode(bucket)
