"""Checks that the S3 server of a store answers. The library waits half a minute for each answer,
and reads a list for as long as the server says that it continues.

The library waits in native code, which nothing interrupts. So a child process asks first, for the
list of an empty folder, and an alarm ends it.
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
from jbclog.core.text import clean, shortened

ENDPOINT: Final = "AWS_ENDPOINT_URL"
KEY: Final = "AWS_ACCESS_KEY_ID"
CREDENTIALS: Final = (
    f"; credentials come from the environment: {KEY}, AWS_SECRET_ACCESS_KEY, AWS_REGION, and"
    f" {ENDPOINT} for a server other than Amazon's"
)
NOTHING: Final = "_nothing"  # no table has this name
MOST_SAID: Final = 100  # characters of host and port
LOADS_S: Final = 60.0  # for the library: a home folder on a network may be slow, or hang
ANSWERS_S: Final = 5.0
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
    """Raise `StoreError` if the server of `store` does not list an empty folder within `ANSWERS_S`.
    The library judges any other answer.
    """
    _ask(store, json.dumps({**options}), os.environ.get(ENDPOINT, ""))


@lru_cache
def _ask(store: str, options: str, endpoint: str) -> None:
    """Ask a server until it has answered once. It may be slow later: then the library's own time
    limit applies.
    """
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
        f"{store}: its server{_host_of(endpoint)} does not answer within {ANSWERS_S:g} s"
        f"{'' if os.environ.get(KEY) else CREDENTIALS}"
    )


def _host_of(endpoint: str) -> str:
    """Return host and port of an address for a message, without a password that the address has."""
    host = endpoint.partition("//")[2].partition("/")[0].rpartition("@")[2]
    return f" {shortened(clean(host), MOST_SAID)} ({ENDPOINT})" if host else ""
