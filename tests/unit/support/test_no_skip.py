"""CI's promise that no test is skipped, held by `tests/conftest.py`."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[2] / "conftest.py"
WHY = "no ser2net here"
SKIPPED = {
    "test": f"import pytest\ndef test_it():\n    pytest.skip('{WHY}')\n",
    "fixture": (
        f"import pytest\n@pytest.fixture\ndef f():\n    pytest.skip('{WHY}')\n"
        "def test_it(f):\n    pass\n"
    ),
    "mark": (
        f"import pytest\n@pytest.mark.skipif(True, reason='{WHY}')\ndef test_it():\n    pass\n"
    ),
    "file": (
        f"import pytest\npytest.skip('{WHY}', allow_module_level=True)\ndef test_it():\n    pass\n"
    ),
}
EXPECTED = "import pytest\n@pytest.mark.xfail\ndef test_it():\n    assert False\n"


def said_of(files: dict[str, str], folder: Path, **environment: str) -> tuple[int, str]:
    """The exit code and the output of pytest over made-up files, with the suite's conftest beside
    them.
    """
    shutil.copy(CONFTEST, folder)
    (folder / "pytest.ini").write_text("[pytest]\n")
    for name, text in files.items():
        (folder / f"test_{name}.py").write_text(text)
    told = {
        name: value
        for name, value in os.environ.items()
        if not name.startswith(("JBCLOG", "PYTEST"))
    }
    # all that was skipped and failed, also after a file that could not be collected
    options = ["-p", "no:cacheprovider", "-rsfExX", "--continue-on-collection-errors"]
    told |= {"PYTHONPATH": str(CONFTEST.parent), "COLUMNS": "200"}  # where its `support` is
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(folder)],
        cwd=folder,
        env=told | environment,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    return done.returncode, done.stdout


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    files = SKIPPED | {"expected": EXPECTED}
    code, said = said_of(files, tmp_path_factory.mktemp("strict"), JBCLOG_NO_SKIP="1")
    assert code == 1
    return said


@pytest.mark.parametrize("what", SKIPPED)
def test_a_skip_fails_where_none_is_allowed(what: str, said: str) -> None:
    told, _, summary = said.partition("short test summary")  # some pytests repeat the reasons there
    assert re.search(rf"^(FAILED|ERROR) test_{what}\.py", summary, re.MULTILINE)
    assert len(re.findall(rf"JBCLOG_NO_SKIP forbids: .*{WHY}", told)) == len(SKIPPED)


def test_an_expected_failure_is_no_skip(said: str) -> None:
    assert "XFAIL test_expected.py" in said


def test_a_skip_is_a_skip_elsewhere(tmp_path: Path) -> None:
    code, said = said_of(SKIPPED, tmp_path)
    assert (code, said.count(WHY)) == (0, len(SKIPPED))
