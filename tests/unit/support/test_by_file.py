"""A session of two workers that collect their files one by one: each test has its own report, and
whatever keeps a test from running is a failure.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[2]
FILES = {
    "conftest.py": """
        import pytest
        from support import by_file
        def pytest_configure(config):
            by_file.register(config)
        """,
    "pytest.ini": """
        [pytest]
        testpaths = tests
        addopts = --import-mode=importlib -p xdist -p pytest_timeout -n2 --dist=loadfile
            --no-loadscope-reorder --strict-markers -rA -m "not long"
        markers = long
        """,
    "tests/conftest.py": """
        import os
        import pytest
        @pytest.fixture(scope="session")
        def whole():
            yield
            print("end of", os.environ["PYTEST_XDIST_WORKER"])
        """,
    "tests/test_a.py": """
        import pytest
        @pytest.fixture(scope="module")
        def numbers():
            return []
        @pytest.mark.parametrize("number", range(3))
        def test_each(number, numbers, whole):
            numbers.append(number)
            assert len(numbers) == number + 1
        def test_wrong():
            assert False
        @pytest.mark.long
        def test_long():
            assert False
        """,
    "tests/deep/test_b.py": "def test_b(whole): pass",
    "tests/deep/test_dies.py": """
        import os
        def test_before(): pass
        def test_dies(): os._exit(3)
        """,
    "tests/deep/test_long.py": """
        import pytest
        @pytest.mark.long
        def test_long(): assert False
        """,
    "tests/test_not_here.py": """
        import pytest
        pytest.skip("not here", allow_module_level=True)
        """,
    "tests/test_nothing.py": "import nothing_of_that_name",
    "tests/test_z.py": "def test_z(whole): pass",
}


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    folder = tmp_path_factory.mktemp("suite")
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        lines = text.strip("\n").splitlines()
        indent = len(lines[0]) - len(lines[0].lstrip())
        (folder / name).write_text("\n".join(line[indent:] for line in lines) + "\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest"],
        cwd=folder,
        env={
            **{name: value for name, value in os.environ.items() if "PYTEST" not in name},
            "PYTHONPATH": str(TESTS),
            "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
            "COLUMNS": "120",
        },
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


@pytest.mark.parametrize(
    "line",
    [
        *(f"PASSED tests/test_a.py::test_each[{number}]" for number in range(3)),
        *("PASSED tests/deep/test_b.py::test_b", "PASSED tests/test_z.py::test_z"),
        "PASSED tests/deep/test_dies.py::test_before",
        "FAILED tests/test_a.py::test_wrong - assert False",
        "FAILED tests/deep/test_dies.py::test_dies - worker 'gw",
        "ERROR tests/test_nothing.py - ImportError while importing test module ",
        "SKIPPED [1] tests/test_not_here.py:2: not here",
        "= 2 failed, 6 passed, 1 skipped, 1 error in ",
    ],
)
def test_what_became_of_each(said: str, line: str) -> None:
    assert said.count(f"\n{line}") + said.count(f"={line}") == 1, said


def test_what_is_not_selected_does_not_run(said: str) -> None:
    assert "test_long" not in said
