"""What a mesh file would take in memory, found before it is read.

A few kilobytes can announce or unpack to gigabytes. What is found here is bounded by the size of the file itself, so
that damaged files, and files made to do harm, end with a `MeshError` at once.
"""

from __future__ import annotations

import base64
import binascii
import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from vofem.errors import MeshError

#: Largest file, and most bytes that the arrays of a file may take.
MOST_BYTES = 2**29

#: Largest count or tag that is taken from a small file: tables of tags take eight bytes for each up to the largest.
_MOST = 10_000_000

_CHUNK = 2**20

#: Bytes of a node in binary Gmsh files of format 2.2: its tag and three coordinates.
_OLD_NODE = np.dtype([("tag", "i4"), ("place", "f8", 3)])


def check_size(source: str, size: int) -> None:
    """Raise a `MeshError` where a mesh file has too many bytes; `source` names it in the message."""
    if size > MOST_BYTES:
        raise _too_large(source, f"has {size / 1e6:.0f} MB")


def check_content(source: str, file: Path, kind: str) -> None:
    """Raise where a mesh file announces or unpacks to more than it may.

    Parameters
    ----------
    source : str
        The file in messages.
    file : Path
    kind : str
        meshio's name of the format.

    Raises
    ------
    MeshError
    """
    {"gmsh": _check_gmsh, "vtu": _check_vtu, "med": _check_med}[kind](source, file)


def _too_large(source: str, what: str) -> MeshError:
    return MeshError(
        f"{source} {what}, expected at most {MOST_BYTES / 1e6:.0f} MB, which hold a beam of several million nodes; "
        "it is damaged, or more than the axis of a beam is in it. Export the axis alone"
    )


def _announces(source: str, count: int, what: str, size: int) -> MeshError:
    return MeshError(
        f"{source} announces {count} {what}, more than its {size} bytes can hold, or than tables of tags may take; it "
        "is damaged, or its tags have gaps: renumber the mesh (Gmsh: Renumber) and write it again"
    )


# -- VTU -------------------------------------------------------------------------------------------------


def _check_vtu(source: str, file: Path) -> None:
    """Unpack the compressed arrays piece by piece, and count what comes out."""
    data = file.read_bytes()
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise MeshError(f"{source} defines entities of XML, which can expand without bounds; a VTU file has none")
    compressor = re.search(rb"<VTKFile[^>]*\bcompressor\s*=\s*[\"']([^\"']*)", data)
    if compressor is None:
        return
    wide = re.search(rb"<VTKFile[^>]*\bheader_type\s*=\s*[\"']UInt64", data) is not None
    big = re.search(rb"<VTKFile[^>]*\bbyte_order\s*=\s*[\"']BigEndian", data) is not None
    header = np.dtype("u8" if wide else "u4").newbyteorder(">" if big else "<")
    total = 0
    for packed in _packed_arrays(data, header):
        for block in packed:
            for count in _unpacked(block, compressor[1]):
                total += count
                if total > MOST_BYTES:
                    raise _too_large(source, f"holds arrays that unpack to more than {MOST_BYTES / 1e6:.0f} MB")


def _packed_arrays(data: bytes, header: np.dtype[Any]) -> Iterator[list[bytes]]:
    """Return the compressed blocks of every array, as far as they can be found."""
    appended = re.search(rb"<AppendedData[^>]*\bencoding\s*=\s*[\"'](\w+)[\"'][^>]*>\s*_", data)
    for tag in re.finditer(rb"<DataArray\b([^>]*)>([^<]*)", data):
        kind = re.search(rb"\bformat\s*=\s*[\"'](\w+)", tag[1])
        if kind is not None and kind[1] == b"binary":
            yield _blocks(tag[2].strip(), header, coded=True)
        offset = re.search(rb"\boffset\s*=\s*[\"']\s*(\d{1,18})", tag[1])
        if appended is not None and kind is not None and kind[1] == b"appended" and offset is not None:
            begin = appended.end() + int(offset[1])
            if appended[1] == b"raw":
                yield _blocks(data[begin:], header, coded=False)
            else:
                yield _blocks(re.split(rb"[<\s]", data[begin:], maxsplit=1)[0], header, coded=True)


def _blocks(text: bytes, header: np.dtype[Any], coded: bool) -> list[bytes]:
    """Return the compressed blocks of one array: a header with their number and sizes goes before them."""
    size = header.itemsize

    def taken(count: int) -> bytes:
        return _decoded(text[: -(-count // 3) * 4])[:count] if coded else text[:count]

    first = taken(size)
    if len(first) < size:
        return []
    count = int(np.frombuffer(first, header)[0])
    whole = (3 + count) * size
    if whole > len(text):
        return []
    sizes = np.frombuffer(taken(whole), header)[3:].tolist()
    content = _decoded(text[-(-whole // 3) * 4 :]) if coded else text[whole:]
    ends = list(itertools.accumulate(sizes, initial=0))
    return [content[a:b] for a, b in itertools.pairwise(ends) if a < len(content)]


def _decoded(text: bytes) -> bytes:
    """Return what base64 text means up to where it is damaged or ends."""
    end = text.find(b"=")
    if end >= 0:
        text = text[: end + (-end) % 4]
    try:
        return base64.b64decode(text[: len(text) // 4 * 4])
    except (binascii.Error, ValueError):
        return b""


def _unpacked(block: bytes, compressor: bytes) -> Iterator[int]:
    """Return the sizes of the pieces into which a block unpacks, which are not kept."""
    import lzma
    import zlib

    try:
        if compressor == b"vtkZLibDataCompressor":
            flate, rest = zlib.decompressobj(), block
            while rest and not flate.eof:
                yield len(flate.decompress(rest, _CHUNK))
                rest = flate.unconsumed_tail
        elif compressor == b"vtkLZMADataCompressor":
            chain = lzma.LZMADecompressor(memlimit=MOST_BYTES)
            piece = chain.decompress(block, _CHUNK)
            while piece:
                yield len(piece)
                piece = b"" if chain.eof else chain.decompress(b"", _CHUNK)
    except (zlib.error, lzma.LZMAError, EOFError):
        return


# -- MED -------------------------------------------------------------------------------------------------


def _check_med(source: str, file: Path) -> None:
    """Add up the arrays of an HDF5 file, and refuse those that lie in other files."""
    import h5py

    total = 0

    def visit(group: Any) -> None:
        nonlocal total
        for name in group:
            link = group.get(name, getlink=True)
            if isinstance(link, h5py.ExternalLink):
                raise MeshError(
                    f"{source} refers to another file, {link.filename!r}; expected one file with everything"
                )
            if isinstance(link, h5py.SoftLink):
                continue
            item = group[name]
            if isinstance(item, h5py.Group):
                # A hard link to a group above would lead around for ever.
                address = h5py.h5o.get_info(item.id).addr
                if address not in seen:
                    seen.add(address)
                    visit(item)
            elif isinstance(item, h5py.Dataset):
                if item.external or item.is_virtual:
                    raise MeshError(f"{source} keeps {item.name!r} in other files; expected one file with everything")
                total += item.size * item.dtype.itemsize if item.shape is not None else 0
                if total > MOST_BYTES:
                    raise _too_large(source, f"holds arrays of more than {MOST_BYTES / 1e6:.0f} MB")

    seen: set[int] = set()
    try:
        with h5py.File(file, "r") as opened:
            visit(opened)
    except MeshError:
        raise
    except Exception:
        # meshio meets the same, and its message is shown.
        return


# -- Gmsh ------------------------------------------------------------------------------------------------


def _check_gmsh(source: str, file: Path) -> None:
    data = file.read_bytes()
    form = re.search(rb"^\$MeshFormat\s+(\S+)\s+([01])\s", data, re.MULTILINE)
    if form is None:
        return
    most = max(len(data), _MOST)
    if form[2] == b"0":
        _check_text(source, data, most)
    elif form[1] == b"4.1":
        _check_binary(source, data, most)
    elif form[1].startswith(b"2"):
        _check_old_binary(source, data, most)
    else:
        raise MeshError(f"{source} is a binary file of format {form[1].decode(errors='replace')}; write format 4.1")


def _check_text(source: str, data: bytes, most: int) -> None:
    """Look at every whole number that may be a count or a tag; in fields of values, counts have lines of their own."""
    digits = len(str(most))
    anywhere = re.compile(rb"(?<![\w.+\"])(\d{%d,})(?![\w.\"])" % digits)
    alone = re.compile(rb"^[ \t]*(\d{%d,})\s*$" % digits, re.MULTILINE)
    for section in re.finditer(rb"^\$(?!End)(\w+)\s*$(.*?)^\$End\1", data, re.MULTILINE | re.DOTALL):
        fields = section[1].endswith(b"Data") or section[1] == b"InterpolationScheme"
        for found in (alone if fields else anywhere).finditer(section[2]):
            count = int(found[1][:40])
            if count > most:
                raise _announces(source, count, f"in ${section[1].decode(errors='replace')}", len(data))


def _check_binary(source: str, data: bytes, most: int) -> None:
    """Follow the blocks of nodes and elements of format 4.1."""
    for section in (b"Nodes", b"Elements"):
        start = re.search(rb"^\$" + section + rb"\s*?\n", data, re.MULTILINE)
        if start is None:
            continue
        at = start.end()

        def numbers(kind: str, count: int, at: int) -> Any:
            dtype = np.dtype(kind)
            if count < 0 or at + count * dtype.itemsize > len(data):
                raise _announces(source, count, f"numbers in ${section.decode()}", len(data))  # noqa: B023
            return np.frombuffer(data, dtype, count, at)

        blocks, whole, *_ = (int(number) for number in numbers("<u8", 4, at))
        if max(blocks, whole) > len(data):
            raise _announces(source, max(blocks, whole), f"entries in ${section.decode()}", len(data))
        at += 32
        for _ in range(blocks):
            numbers("<i4", 3, at)
            count = int(numbers("<u8", 1, at + 12)[0])
            at += 20
            tags = numbers("<u8", count, at)
            if section == b"Elements":
                # How long an element is depends on its kind; meshio reads them, no more than there are.
                break
            if count and int(tags.max()) > most:
                raise _announces(source, int(tags.max()), "as a tag in $Nodes", len(data))
            at += count * 32


def _check_old_binary(source: str, data: bytes, most: int) -> None:
    """Look at the tags of nodes of format 2.2."""
    nodes = re.search(rb"^\$Nodes\s*\n(\d{1,18})\s*?\n", data, re.MULTILINE)
    if nodes is None:
        return
    count = int(nodes[1])
    if nodes.end() + count * _OLD_NODE.itemsize > len(data):
        raise _announces(source, count, "nodes", len(data))
    tags = np.frombuffer(data, _OLD_NODE, count, nodes.end())["tag"]
    if count and int(tags.max()) > most:
        raise _announces(source, int(tags.max()), "as a tag in $Nodes", len(data))
