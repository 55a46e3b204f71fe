"""For all tests: with JBCLOG_NO_SKIP in the environment a skipped test is a failed one, so that CI lets none slip by."""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from collections.abc import Generator
from typing import Any

import pytest
from hypothesis import settings

settings.register_profile("unhurried", deadline=None)  # a busy machine must not fail a property
settings.load_profile("unhurried")

os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="jbclog-tests-")  # leases that tests leave open are not the user's

NO_SKIP = bool(os.environ.get("JBCLOG_NO_SKIP"))

atexit.register(shutil.rmtree, os.environ["XDG_STATE_HOME"], ignore_errors=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """A test that was skipped."""
    report = yield
    return _failed_if_skipped(report)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """A file that was skipped as a whole."""
    report = yield
    return _failed_if_skipped(report)


def _failed_if_skipped(report: Any) -> Any:
    if NO_SKIP and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"skipped, which JBCLOG_NO_SKIP forbids: {report.longrepr[-1]}"
    return report
