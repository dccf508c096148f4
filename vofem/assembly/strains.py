"""Strains of bodies and attachments, and the rigid motions, which cause no strain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vofem.assembly.triplets import Triplets, stacked
from vofem.assembly.unknowns import Unknowns
from vofem.bodies.base import Array, Body, IntArray, Row
from vofem.linalg.null_space import null_space, sparse_null_space

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


def attached_strains(
    springs: Sequence[tuple[Row, float]], blocks: Sequence[tuple[int, csr_matrix]], size: int
) -> csr_matrix | None:
    """Return the strain rows of springs and foundations over all degrees of freedom, or None.

    `springs`: rows and stiffnesses.
    `blocks`: strain rows over the degrees of freedom of one body, and where these begin.
    `size`: number of all degrees of freedom.
    """
    from scipy.sparse import csr_matrix, vstack

    parts = []
    if springs:
        parts.append(stacked([Row(row.indices, np.sqrt(k) * row.weights) for row, k in springs], size))
    for start, strains in blocks:
        shifted = (strains.data, strains.indices + start, strains.indptr)
        parts.append(csr_matrix(shifted, shape=(strains.shape[0], size)))
    return vstack(parts, format="csr") if parts else None


def strain_rows(
    offsets: dict[Body, int], attached: csr_matrix | None, size: int, unknown: Unknowns
) -> csr_matrix | None:
    """Return D with ``K = D'D`` over the free degrees of freedom, or None."""
    from scipy.sparse import vstack

    parts, count = Triplets(), 0
    for body, start in offsets.items():
        rows = body.strain_rows()
        if rows is None:
            return None
        parts.add_matrix(rows, count, start)
        count += rows.shape[0]
    whole: Any = parts.build(count, size)
    if attached is not None:
        whole = vstack([whole, attached], format="csr")
    return unknown.rows(whole) if unknown.free.size < size else whole


def rigid_motions(
    offsets: dict[Body, int], attached: csr_matrix | None, conditions: csr_matrix | None, supported: IntArray, size: int
) -> Array:
    """Return a basis, shape (N, r), of the rigid motions that supports and joints permit.

    They are found among the rigid motions of the bodies, which is a problem of a few unknowns. With the large matrices
    a soft body could not be distinguished from a free one.
    """
    blocks: list[tuple[int, Array]] = []
    for body, start in offsets.items():
        motions = body.rigid_motions()
        held = supported[(supported >= start) & (supported < start + body.size)] - start
        rotation = body.degrees_of_freedom.rotation
        largest = np.abs(motions).max(axis=1, initial=0.0)
        # Rotations are compared with rotations, whose numbers depend on the unit of length.
        terms = np.where(rotation, largest.max(where=rotation, initial=0.0), largest.max(where=~rotation, initial=0.0))
        motions = motions @ null_space(motions[held], np.broadcast_to(terms[held, None], motions[held].shape))
        blocks.extend((start, motions[:, [k]]) for k in range(motions.shape[1]))
    from scipy.sparse import csr_matrix, vstack

    if not blocks:
        return np.zeros((size, 0))
    places = np.concatenate([start + np.arange(motion.shape[0]) for start, motion in blocks])
    columns = np.repeat(np.arange(len(blocks)), [motion.shape[0] for _, motion in blocks])
    entries = np.concatenate([motion[:, 0] for _, motion in blocks])
    basis = csr_matrix((entries, (places, columns)), shape=(size, len(blocks)))
    resisted = [part for part in (attached, conditions) if part is not None]
    if not resisted:
        return np.asarray(basis.toarray())
    rows: Any = vstack(resisted, format="csr") if len(resisted) > 1 else resisted[0]
    return np.asarray(basis @ sparse_null_space(rows @ basis, abs(rows) @ abs(basis)))
