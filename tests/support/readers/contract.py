"""The contract: which tests it has (`tests/contract.toml`), and their hashes
(`tests/CONTRACT.sha256`).

``python tests/support readers.contract [--check]``, which is `.ci/contract`.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from support.readers.texts import ROOT

TESTS = ROOT / "tests"
ALL = "*"
HEAD = """\
# Made by `.ci/contract` of the files that tests/contract.toml lists; compared by
# `.ci/contract --check`.
"""
SECTIONS = {
    "A": """
# A: no byte may change. What of the package moves is changed in tests/support/product.py.
""",
    "B": """
# B: no assert may change. A changed line is an import, `yield` to `await`, or how a constant is
# got. A feature that goes takes its lines along, in the same commit, which says so.
""",
}


@dataclass(frozen=True)
class Contract:
    """What `contract.toml` lists: section -> folder below `tests` -> names of files."""

    tests: Path
    lists: dict[str, dict[str, list[str]]]

    @classmethod
    def read(cls, tests: Path = TESTS) -> Contract:
        return cls(tests, tomllib.loads((tests / "contract.toml").read_text(encoding="utf-8")))

    def files(self, section: str) -> list[Path]:
        """Return the files of a section, those that are missing too."""
        found: set[Path] = set()
        for folder, names in self.lists[section].items():
            if ALL in names:
                named = self._named(folder)
                found |= {path for path in self._modules(folder) if path.stem not in named}
            found |= {self.tests / folder / f"{name}.py" for name in names if name != ALL}
        return sorted(found)

    def undecided(self) -> list[Path]:
        """Return the files in folders of the contract that no section lists: folders of which a
        section has everything, or some files are outside.
        """
        decided = {path for section in self.lists for path in self.files(section)}
        folders = {*self.lists["outside"]}
        for section in SECTIONS:
            folders |= {folder for folder, names in self.lists[section].items() if ALL in names}
        modules = {path for folder in folders for path in self._modules(folder)}
        return sorted(modules - decided)

    def _named(self, folder: str) -> set[str]:
        """Return the names that any section has for a folder."""
        return {name for lists in self.lists.values() for name in lists.get(folder, ())} - {ALL}

    def _modules(self, folder: str) -> list[Path]:
        """Return what is in a folder; an empty `__init__.py` says nothing."""
        return [path for path in (self.tests / folder).glob("*.py") if path.stat().st_size]

    # -- hashes ------------------------------------------------------------------------------------

    @property
    def path(self) -> Path:
        return self.tests / "CONTRACT.sha256"

    def text(self) -> str:
        """Return what the file of hashes is to have, in the form of `sha256sum`."""
        lines = [HEAD]
        for section, said in SECTIONS.items():
            lines.append(said)
            for path in self.files(section):
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                lines.append(f"{digest}  {self._name(path)}\n")
        return "".join(lines)

    def differences(self) -> Iterator[str]:
        """Yield what is not as it was frozen."""
        frozen = self._frozen()
        for section in SECTIONS:
            for path in self.files(section):
                name = self._name(path)
                was = frozen.pop((section, name), None)
                if not path.exists():
                    yield f"{section} {name}: missing"
                elif was is None:
                    yield f"{section} {name}: new"
                elif was != hashlib.sha256(path.read_bytes()).hexdigest():
                    yield f"{section} {name}: changed"
        for section, name in frozen:
            state = "not listed any more" if (self.tests.parent / name).exists() else "missing"
            yield f"{section} {name}: {state}"
        for path in self.undecided():
            yield f"{self._name(path)}: new, in no list of tests/contract.toml"

    def _frozen(self) -> dict[tuple[str, str], str]:
        """Return the stored hashes by section and name."""
        frozen: dict[tuple[str, str], str] = {}
        section = ""
        for line in self.path.read_text(encoding="utf-8").splitlines():
            if line.startswith("#"):
                begun = line.removeprefix("# ").partition(":")[0]
                section = begun if begun in SECTIONS else section
            elif line:
                digest, _, name = line.partition("  ")
                frozen[section, name] = digest
        return frozen

    def _name(self, path: Path) -> str:
        return path.relative_to(self.tests.parent).as_posix()


def main() -> int:
    parser = argparse.ArgumentParser(prog=".ci/contract", description="hashes of the contract")
    parser.add_argument("--check", action="store_true", help="compare; end with 1 at a difference")
    given = parser.parse_args()
    contract = Contract.read()
    if not given.check:
        contract.path.write_text(contract.text(), encoding="utf-8")
        return 0
    found = list(contract.differences())
    if not found:
        frozen = sum(len(contract.files(section)) for section in SECTIONS)
        print(f"{frozen} files as frozen")
        return 0
    print(*found, sep="\n")
    print("If a change is right, say in the commit why, and freeze it: .ci/contract")
    return 1


if __name__ == "__main__":
    sys.exit(main())
