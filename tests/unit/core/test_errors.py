"""What an error says of itself."""

from __future__ import annotations

from jbclog.core.errors import cause

ACERO = "The pyarrow installation is not built with support for 'acero' (libarrow_acero.so: {})"


def test_a_library_that_is_refused_memory_says_so_and_not_that_it_is_not_installed() -> None:
    refused = ACERO.format("failed to map segment from shared object")
    assert cause(ImportError(refused)) == f"memory was refused: {refused}"
    missing = ACERO.format("cannot open shared object file: No such file or directory")
    assert cause(ImportError(missing)) == missing
    assert cause(MemoryError()) == "memory was refused"
