"""Whether the S3 server of a store answers at all: the library waits half a minute for each answer,
and follows a list for as long as the server says that it continues.

It waits in native code, which nothing interrupts. So a process of its own asks first, for a list
that is empty, and is ended by its alarm.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

from jbclog.core.errors import StoreError
from jbclog.core.foreign.files import ANSWERS_S
from jbclog.core.text import clean, shortened

ENDPOINT: Final = "AWS_ENDPOINT_URL"
KEY: Final = "AWS_ACCESS_KEY_ID"
CREDENTIALS: Final = (
    f"; credentials come from the environment: {KEY}, AWS_SECRET_ACCESS_KEY, AWS_REGION, and"
    f" {ENDPOINT} for a server that is not Amazon's"
)
NOTHING: Final = "_nothing"  # no table has this name
MOST_SAID: Final = 100
LOADS_S: Final = 60.0  # for the library: a home folder on a network may be slow, or hang
ASK: Final = """
import signal, sys
signal.signal(signal.SIGALRM, signal.SIG_DFL)
signal.setitimer(signal.ITIMER_REAL, float(sys.argv[4]))
import json
from deltalake import DeltaTable
print("loaded", flush=True)
signal.setitimer(signal.ITIMER_REAL, float(sys.argv[1]))
DeltaTable.is_deltatable(sys.argv[2], json.loads(sys.argv[3]))
"""


def expect_list(store: str, options: Mapping[str, str]) -> None:
    """Raise `StoreError` where the server of `store` does not list an empty folder within
    `ANSWERS_S`. Whatever else it answers is the library's to judge.
    """
    _ask(store, json.dumps({**options}), os.environ.get(ENDPOINT, ""))


@lru_cache
def _ask(store: str, options: str, endpoint: str) -> None:
    """Ask once: one that has answered may be slow later."""
    folder = f"{store.rstrip('/')}/{NOTHING}"
    ended = subprocess.run(
        [sys.executable, "-P", "-c", ASK, str(ANSWERS_S), folder, options, str(LOADS_S)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
        check=False,
    )
    if ended.returncode != -signal.SIGALRM:
        return
    if not ended.stdout:
        raise StoreError(
            f"{store}: its server was not asked: deltalake did not load within {LOADS_S:g} s"
        )
    raise StoreError(
        f"{store}: its server{_named(endpoint)} does not answer within {ANSWERS_S:g} s"
        f"{'' if os.environ.get(KEY) else CREDENTIALS}"
    )


def _named(endpoint: str) -> str:
    """Return host and port; before them an address may have a password."""
    host = endpoint.partition("//")[2].partition("/")[0].rpartition("@")[2]
    return f" {shortened(clean(host), MOST_SAID)} ({ENDPOINT})" if host else ""
