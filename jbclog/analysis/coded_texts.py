"""Text columns as codes, whether they were read as dictionaries or as plain text."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray


def coded(texts: pa.ChunkedArray | pa.Array) -> pa.DictionaryArray:
    """Return a column of texts with one dictionary, which may have texts that no row has."""
    if not pa.types.is_dictionary(texts.type):
        texts = texts.cast(pa.string()).dictionary_encode()
    return texts.combine_chunks() if isinstance(texts, pa.ChunkedArray) else texts


def is_one_of(texts: pa.ChunkedArray | pa.Array, words: Collection[str]) -> NDArray[np.bool_]:
    """Return which texts are one of these words; a missing text is not."""
    column = coded(texts)
    known = [word in words for word in column.dictionary.to_pylist()]
    codes = pc.fill_null(column.indices, len(known)).to_numpy(zero_copy_only=False)
    return np.asarray(np.array([*known, False])[codes], dtype=np.bool_)
