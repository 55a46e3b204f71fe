"""What a release is made of and how it is made: the audit of the lock, its bill of materials, the
commands of its page.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import distributions
from importlib.util import find_spec
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from support.product import package
from support.readers.texts import ROOT

CI = ROOT / ".ci"
LOCK = (CI / "requirements.lock").read_text(encoding="utf-8")
LOCKED = {
    (name.lower(), version): set(re.findall(r"--hash=sha256:([0-9a-f]{64})", rest))
    for name, version, rest in re.findall(
        r"^([\w.-]+)(?:\[[\w,-]+\])?==(\S+)((?: \\\n    --hash=\S+)+)", LOCK, re.MULTILINE
    )
}
TOOLS = Path(sys.executable).parent


def ended(
    *command: str | Path, cwd: Path = ROOT, **environment: str
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*map(str, command)],
        cwd=cwd,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
        timeout=200,
    )


def test_the_lock_is_read_whole() -> None:
    assert len(LOCKED) == LOCK.count("==") > 50
    assert all(LOCKED.values())


def test_the_lock_names_the_extras_that_its_packages_ask_for() -> None:
    """By hashes, pip takes `coverage==1` for `coverage[toml]` only while there is no later one."""
    asked = {
        f"{canonicalize_name(one.name)}[{','.join(sorted(one.extras))}]"
        for found in distributions()
        for one in map(Requirement, found.requires or ())
        if one.extras
        and (canonicalize_name(found.name), found.version) in LOCKED
        and (one.marker is None or one.marker.evaluate({"extra": ""}))
    }
    assert asked <= {line.partition("==")[0] for line in LOCK.splitlines()}


# -- known vulnerabilities -------------------------------------------------------------------------

CLEAN = {"name": "a", "version": "1", "vulns": []}
SKIPPED = {
    "name": "b",
    "skip_reason": "Dependency not found on PyPI and could not be audited: b (1)",
}
VULNERABLE = {"name": "c", "version": "1", "vulns": [{"id": "PYSEC-1", "fix_versions": ["2"]}]}


@pytest.mark.parametrize(
    ("packages", "code", "code_if_it_must", "last"),
    [
        ([CLEAN], 0, 0, "audited: no known vulnerability in 1 packages"),
        (
            [CLEAN, SKIPPED],
            0,
            2,
            "NOT AUDITED for known vulnerabilities: 1 of 2 packages are unknown to the service",
        ),
        ([CLEAN, SKIPPED, VULNERABLE], 1, 1, "VULNERABLE: 1 known in what requirements.lock names"),
        ([], 0, 2, "NOT AUDITED for known vulnerabilities: it named no package"),
        (None, 0, 2, "NOT AUDITED for known vulnerabilities: the service cannot be reached"),
    ],
)
def test_what_was_not_audited_is_never_called_audited(
    packages: object, code: int, code_if_it_must: int, last: str, tmp_path: Path
) -> None:
    """pip-audit itself ends with 0 and "No known vulnerabilities found" where the service knew not
    one of the packages.
    """
    said = (
        "sys.exit('the service cannot be reached')"
        if packages is None
        else f"print({json.dumps({'dependencies': packages})!r})"
    )
    (tmp_path / "pip_audit.py").write_text(f"import sys\n{said}\n")
    for options, expected in (((), code), (("--must",), code_if_it_must)):
        done = ended(sys.executable, CI / "audit", *options, PYTHONPATH=str(tmp_path))
        assert (done.stdout.splitlines()[-1], done.returncode) == (last, expected)


def test_all_checks_end_where_one_is_vulnerable_and_say_in_the_last_line_what_was_not_audited(
    tmp_path: Path,
) -> None:
    """The lines of `.ci/run` about it, with an audit that is made up: all of it cannot be run here,
    because it runs these tests.
    """
    lines = (CI / "run").read_text(encoding="utf-8").splitlines()
    about = [line for line in lines if "audited" in line]
    assert lines[-1] == about[-1]
    (tmp_path / ".ci").mkdir()
    for code, last in ((0, "all checks hold; NOT AUDITED: away"), (1, "NOT AUDITED: away")):
        (tmp_path / ".ci" / "audit").write_text(
            f"print('two')\nprint('NOT AUDITED: away')\nraise SystemExit({code})\n"
        )
        task = 'poe() { "$TOOLS/python" ".ci/$1"; }'
        done = ended(
            "bash",
            "-euo",
            "pipefail",
            "-c",
            "\n".join([task, *about]),
            cwd=tmp_path,
            TOOLS=str(TOOLS),
        )
        assert (done.stdout.splitlines()[-1], done.returncode) == (last, code)


# -- the bill of materials -------------------------------------------------------------------------


@pytest.fixture
def tools() -> str:
    """Where the tools of the lock are; README's own environment does not have them."""
    if find_spec("cyclonedx_py") is None or find_spec("hatchling") is None:
        pytest.skip("needs cyclonedx-bom and hatchling, which the lock names")
    return str(TOOLS)


def assert_names_every_locked_package_with_version_and_hashes(path: Path) -> None:
    bill = json.loads(path.read_text(encoding="utf-8"))
    named = {
        (one["name"].lower(), one["version"]): {
            found["content"]
            for source in one["externalReferences"]
            for found in source.get("hashes", ())
            if found["alg"] == "SHA-256"
        }
        for one in bill["components"]
    }
    assert named == LOCKED
    assert all(
        one["purl"] == f"pkg:pypi/{one['name'].lower()}@{one['version']}"
        for one in bill["components"]
    )
    root = bill["metadata"]["component"]
    assert (bill["bomFormat"], root["name"], root["version"]) == (
        "CycloneDX",
        "jbclog",
        package.__version__,
    )


# -- a release -------------------------------------------------------------------------------------


@pytest.fixture
def signer() -> Iterator[dict[str, str]]:
    """A key of its own, which signs without asking; its agent ends with it."""
    if shutil.which("gpg") is None or not (ROOT / ".git").exists():
        pytest.skip("needs gpg (Debian package gnupg) and a clone")
    home = tempfile.mkdtemp(prefix="gpg")  # a short path: the agent's socket lies in it
    config = Path(home, "gitconfig")
    config.write_text(
        "[user]\nname = T\nemail = t@example.org\n[safe]\ndirectory = *\n", encoding="utf-8"
    )  # a clone of another user's
    environment = {"GNUPGHOME": home, "GIT_CONFIG_GLOBAL": str(config)}
    done = ended(
        "gpg",
        "--batch",
        "--passphrase",
        "",
        "--quick-gen-key",
        "T <t@example.org>",
        "ed25519",
        "sign",
        **environment,
    )
    assert done.returncode == 0, done.stderr
    yield environment
    ended("gpgconf", "--kill", "gpg-agent", GNUPGHOME=home)
    shutil.rmtree(home, ignore_errors=True)


def test_the_page_s_commands_make_a_release_that_its_user_can_verify_and_build_again(
    tools: str, signer: dict[str, str], tmp_path: Path
) -> None:
    page = (ROOT / "docs" / "how-to" / "releasing.md").read_text(encoding="utf-8")
    blocks = dict(re.findall(r"^```sh (\w+)\n(.*?)^```$", page, re.DOTALL | re.MULTILINE))
    assert [*blocks] == ["tag", "build", "verify", "rebuild"]
    clone = tmp_path / "clone"
    cloned = ended("git", "clone", "--quiet", "--no-tags", ROOT, clone, **signer)
    assert cloned.returncode == 0, cloned.stderr
    (clone / "not committed").touch()
    script = "set -e\n" + blocks["tag"] + blocks["build"] + blocks["rebuild"]
    done = ended("bash", "-c", script, cwd=clone, JBCLOG_TOOLS=tools, **signer)
    assert done.returncode == 0, done.stdout + done.stderr
    (made,) = [path for path in (clone / "dist").iterdir() if path.name != "again"]
    name = f"jbclog-{package.__version__}"
    assert made.name == f"v{package.__version__}"
    assert {path.name for path in made.iterdir()} == {
        *(
            f"{name}.tar.gz",
            f"{name}-py3-none-any.whl",
            f"{name}.cdx.json",
            "SHA256SUMS",
            "SHA256SUMS.asc",
        )
    }
    assert_names_every_locked_package_with_version_and_hashes(made / f"{name}.cdx.json")
    assert "not committed" not in ended("tar", "-tzf", made / f"{name}.tar.gz").stdout
    verify = f"set -e\n{blocks['verify']}"
    assert ended("bash", "-c", verify, cwd=made, **signer).returncode == 0
    for changed in (f"{name}.cdx.json", "SHA256SUMS"):
        whole = (made / changed).read_bytes()
        (made / changed).write_bytes(whole + b"\n")
        assert ended("bash", "-c", verify, cwd=made, **signer).returncode != 0, changed
        (made / changed).write_bytes(whole)


# -- the hosted workflows --------------------------------------------------------------------------


def test_workflows_run_what_is_here_with_no_more_rights_than_they_need() -> None:
    texts = {
        path.name: path.read_text(encoding="utf-8")
        for path in (ROOT / ".github" / "workflows").glob("*.yml")
    }
    assert {"checks.yml", "supply-chain.yml", "release.yml"} <= {*texts}
    for name, text in texts.items():
        assert "\npermissions:\n  contents: read\n" in text, name
        for used in re.findall(r"uses: (\S+)", text):
            assert re.fullmatch(r"[\w./-]+@[0-9a-f]{40}", used), (
                f"{name}: {used} is not pinned to a commit"
            )
        for script in re.findall(r"\.ci/[\w.]+", text):
            assert (ROOT / script).exists(), f"{name}: {script}"
    assert "poe audit --must" in texts["supply-chain.yml"]
