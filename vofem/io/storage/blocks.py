"""Long arrays over time, written and read in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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


def empty_dataset(group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any) -> h5py.Dataset:
    """Return a new dataset of rows, in chunks of whole rows as far as these fit."""
    dtype = np.dtype(dtype)
    if not all(shape):
        return group.create_dataset(name, shape=shape, dtype=dtype)
    inner = list(shape[1:])
    if inner:
        inner[0] = min(inner[0], max(1, _CHUNK // dtype.itemsize))
    rows = max(1, _CHUNK // (dtype.itemsize * int(np.prod(inner, dtype=np.int64))))
    chunks = (min(shape[0], rows), *inner)
    return group.create_dataset(name, shape=shape, dtype=dtype, chunks=chunks, **FILTERS)


def write_columns(blocks: Blocks, group: h5py.Group, name: str, values: NDArray) -> h5py.Dataset:
    """Write values of shape (n, n_times) as a dataset (n_times, n)."""
    dataset = stream_columns(blocks, group, name, values.shape, values.dtype, lambda part: values[:, part])
    # An array of one row or column is contiguous in both orders.
    dataset.attrs["fortran"] = bool(values.flags.f_contiguous and not values.flags.c_contiguous)
    return dataset


def stream_columns(
    blocks: Blocks, group: h5py.Group, name: str, shape: tuple[int, ...], dtype: Any, of: Callable[[slice], NDArray]
) -> h5py.Dataset:
    """Write values of shape (n, n_times), which a function gives for a slice of times, as a dataset (n_times, n)."""
    dataset = empty_dataset(group, name, shape[::-1], dtype)
    if all(shape):
        for part in block_slices(shape[1], shape[0] * dataset.dtype.itemsize):
            dataset[part] = of(part).T
            blocks.flush()
    return dataset


def read_columns(dataset: h5py.Dataset) -> NDArray:
    """Return values of shape (n, n_times), in the order in memory that they had."""
    order: Any = "F" if dataset.attrs["fortran"] else "C"
    values = np.empty(dataset.shape[::-1], dtype=dataset.dtype, order=order)
    if values.size:
        for part in block_slices(dataset.shape[0], dataset.shape[1] * dataset.dtype.itemsize):
            values[:, part] = dataset[part].T
    return values


def write_rows(blocks: Blocks, group: h5py.Group, name: str, rows: NDArray) -> None:
    """Write an array as a dataset, some rows at a time."""
    dataset = empty_dataset(group, name, rows.shape, rows.dtype)
    if rows.size:
        for part in block_slices(rows.shape[0], int(np.prod(rows.shape[1:])) * rows.dtype.itemsize):
            dataset[part] = rows[part]
            blocks.flush()
