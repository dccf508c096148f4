"""Long arrays over time, written and read in blocks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from vofem.files.hdf5 import FILTERS, Blocks

#: Size in bytes of a chunk, which is compressed as a whole, and of a block, after which the file is flushed.
_CHUNK, _BLOCK = 1 << 20, 1 << 23


def block_slices(count: int, row_bytes: int) -> Iterator[slice]:
    """Yield slices of rows, each of a bounded size."""
    step = max(1, _BLOCK // max(row_bytes, 1))
    for start in range(0, count, step):
        yield slice(start, min(start + step, count))


def chunks(shape: tuple[int, ...], itemsize: int) -> tuple[int, ...]:
    """Return the shape of a chunk of an array without zeros in its shape: whole rows as far as these fit."""
    inner = list(shape[1:])
    if inner:
        inner[0] = min(inner[0], max(1, _CHUNK // itemsize))
    rows = max(1, _CHUNK // (itemsize * int(np.prod(inner, dtype=np.int64))))
    return (min(shape[0], rows), *inner)


def empty_dataset(group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any) -> h5py.Dataset:
    """Return a new dataset, to be written by rows."""
    dtype = np.dtype(dtype)
    filters = {"chunks": chunks(shape, dtype.itemsize), **FILTERS} if all(shape) else {}
    return group.create_dataset(name, shape=shape, dtype=dtype, **filters)


def write_rows(blocks: Blocks, group: h5py.Group, name: str, rows: NDArray) -> None:
    """Write an array as a dataset, some rows at a time."""
    dataset = empty_dataset(group, name, rows.shape, rows.dtype)
    if rows.size:
        for part in block_slices(rows.shape[0], int(np.prod(rows.shape[1:])) * rows.dtype.itemsize):
            dataset[part] = rows[part]
            blocks.flush()
