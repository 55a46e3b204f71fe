"""For workers of pytest-xdist: a file of tests is imported and collected when its turn comes, and
by the worker that runs it.

Without it each of six workers imports all files and makes ten thousand tests, and only then does
the first one run. What is distributed are the names of the files.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from support import once

SELECTING = ("keyword", "deselect", "lf", "failedfirst", "newfirst", "stepwise", "collectonly")
"""Options that look at the tests of all files before the first one runs."""


def register(config: pytest.Config) -> None:
    """Have it so, where the folders of tests are run as they are."""
    if not _is_wanted(config):
        return
    if hasattr(config, "workerinput"):
        config.pluginmanager.register(ByFile())
    elif config.getoption("dist", "no") != "no":
        config.pluginmanager.register(Distribution())


def _is_wanted(config: pytest.Config) -> bool:
    """Whether the folders of tests are run as they are."""
    folders = [config.rootpath / each for each in config.getini("testpaths")]
    return [Path(each).resolve() for each in config.args] == folders and not any(
        config.getoption(name, None) for name in SELECTING
    )


class Later(pytest.File):
    """A file that has not been imported."""

    def collect(self) -> Iterator[WholeFile]:
        yield WholeFile.from_parent(self, name="all")


class WholeFile(pytest.Item):
    """Its tests, one after the other, each with a report of its own."""

    def __init__(self, **named: Any) -> None:
        super().__init__(**named)
        self.add_marker(pytest.mark.timeout(0))  # each test has its own
        self.following: pytest.Item | None = None

    def runtest(self) -> None:
        session = self.session
        place = session.items.index(self)
        tests = self._collected()
        for test, next_one in zip(tests, [*tests[1:], self.following], strict=False):
            session.items[place] = test  # xdist's worker looks there for what it reports
            self.config.hook.pytest_runtest_protocol(item=test, nextitem=next_one)
            if session.shouldfail or session.shouldstop:
                break
        session.items[place] = self
        # where no test ran: of the file before, what the following one does not share
        session._setupstate.teardown_exact(self.following)

    def _collected(self) -> list[pytest.Item]:
        gc.disable()
        try:
            with once.set_aside():
                folder = self.parent.parent if self.parent else None
                module: Any = pytest.Module.from_parent(folder, path=self.path)
                tests = list(self.session.genitems(module))
            self.config.hook.pytest_collection_modifyitems(
                session=self.session, config=self.config, items=tests
            )
        finally:
            gc.freeze()  # what was imported stays
            gc.enable()
        return tests


class ByFile:
    """The plugin of a worker."""

    @pytest.hookimpl(tryfirst=True)
    def pytest_pycollect_makemodule(self, module_path: Path, parent: Any) -> Later:
        return Later.from_parent(parent, path=module_path)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(
        self, item: pytest.Item, nextitem: pytest.Item | None
    ) -> bool | None:
        if not isinstance(item, WholeFile):
            return None
        item.following = nextitem
        item.runtest()
        return True


class Distribution:
    """The plugin of the session that distributes. It shows per cent of the files, as far as tests
    of them were reported: how many tests there are nobody knows before the end.
    """

    def __init__(self) -> None:
        self._files: set[str] = set()
        self._tests: set[str] = set()
        self._all_files = 0
        self._begun: dict[str, str] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionstart(self, session: pytest.Session) -> None:
        self._session = session

    @pytest.hookimpl
    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._begun[nodeid.partition("::")[0]] = nodeid

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._all_files = self._all_files or self._session.testscollected
        self._files.add(report.nodeid.partition("::")[0])
        self._tests.add(report.nodeid)
        self._session.testscollected = len(self._tests) * self._all_files // len(self._files)

    @pytest.hookimpl
    def pytest_xdist_make_scheduler(self, config: pytest.Config, log: Any) -> Any:
        """A worker has the file that it runs and the next one."""
        from xdist.scheduler import LoadFileScheduling

        begun = self._begun

        class Files(LoadFileScheduling):  # type: ignore[misc]
            def _reschedule(self, node: Any) -> None:
                while not node.shutting_down and self._pending_of(self.assigned_work[node]) < 2:
                    super()._reschedule(node)

            def remove_node(self, node: Any) -> str | None:
                """The file that a worker died of is not tried again, the next one is."""
                work = self.assigned_work.pop(node)
                left = [path for path, tests in work.items() if not all(tests.values())]
                for path in left[1:]:
                    self.workqueue[path] = work[path]
                for other in self.assigned_work:
                    self._reschedule(other)
                return begun.get(left[0], left[0]) if left else None

        return Files(config, log)
