"""Mesh files that announce or unpack to more than they hold end with a `MeshError` at once, in little memory."""

import base64
import os
import struct
import threading
import time
import tracemalloc
import zlib
from pathlib import Path

import h5py
import meshio
import pytest

import vofem as vf
from vofem.bodies import mesh_size

MESHES = Path(__file__).parent.parent / "meshes"


def refused(path, *parts, within=3.0):
    """Check the refusal of a file, that it takes little memory, and that it does not hang."""
    tracemalloc.start()
    start = time.monotonic()
    with pytest.raises(vf.MeshError) as caught:
        vf.Beam.from_mesh(path, 1.0, 1.0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert time.monotonic() - start < 10.0 * within
    assert peak < 3e8
    for part in (*parts, str(path)):
        assert part in str(caught.value)


def vtu(path, array, tail=b""):
    """Write a VTU file with one compressed array of points."""
    path.write_bytes(
        b"<?xml version='1.0'?><VTKFile type='UnstructuredGrid' version='0.1' byte_order='LittleEndian' "
        b"header_type='UInt32' compressor='vtkZLibDataCompressor'><UnstructuredGrid><Piece NumberOfPoints='2' "
        b"NumberOfCells='1'><Points>" + array + b"</Points></Piece></UnstructuredGrid>" + tail + b"</VTKFile>"
    )
    return path


def packed(size, blocks):
    """Return header and blocks of zeros that unpack to `size` bytes each."""
    one = zlib.compressobj(9)
    content = b"".join(one.compress(bytes(2**20)) for _ in range(size // 2**20)) + one.flush()
    # The header says that each block holds 16 bytes.
    return struct.pack(f"<{3 + blocks}I", blocks, 16, 16, *[len(content)] * blocks), content * blocks


@pytest.mark.parametrize("encoding", ["binary", "base64", "raw"])
def test_compressed_arrays_that_unpack_to_too_much(tmp_path, encoding):
    header, content = packed(2**26, 10)  # 670 MB out of 0.65 MB
    coded = base64.b64encode(header) + base64.b64encode(content)
    tag = b"<DataArray type='Float64' NumberOfComponents='3' Name='Points' format='%s'%s>%s</DataArray>"
    path = tmp_path / "bomb.vtu"
    if encoding == "binary":
        vtu(path, tag % (b"binary", b"", coded))
    else:
        body = b"_" + (coded if encoding == "base64" else header + content)
        appended = b"<AppendedData encoding='%s'>%s</AppendedData>" % (encoding.encode(), body)
        vtu(path, tag % (b"appended", b" offset='0'", b""), appended)
    refused(path, "unpack to more than 537 MB", "Export the axis alone")


def test_compressed_files_that_are_beams_are_read(tmp_path):
    mesh = meshio.read(MESHES / "beam25.vtu")
    for compression in ("zlib", "lzma", None):
        meshio.write(tmp_path / "beam.vtu", mesh, compression=compression)
        assert vf.Beam.from_mesh(tmp_path / "beam.vtu", 1.0, 1.0).length == pytest.approx(1.0)


def test_what_is_unpacked_is_what_meshio_unpacks(tmp_path, monkeypatch):
    mesh = meshio.read(MESHES / "beam25.vtu")
    path = tmp_path / "beam.vtu"
    seen = []
    unpacked = mesh_size._unpacked
    monkeypatch.setattr(mesh_size, "_unpacked", lambda *given: [seen.append(n) or n for n in unpacked(*given)])
    for compression in ("zlib", "lzma"):
        seen.clear()
        meshio.write(path, mesh, compression=compression)
        vf.Beam.from_mesh(path, 1.0, 1.0)
        assert sum(seen) >= 26 * 3 * 8 + 25 * (2 * 8 + 8)


def test_entities_of_xml_do_not_expand(tmp_path):
    lines = [f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 12)]
    path = tmp_path / "laughs.vtu"
    path.write_text(f"<?xml version='1.0'?><!DOCTYPE x [<!ENTITY a0 'ha'>{''.join(lines)}]><VTKFile>&a11;</VTKFile>")
    refused(path, "defines entities")


def test_med_files_of_many_zeros_or_other_files(tmp_path):
    path = tmp_path / "bomb.med"
    with h5py.File(path, "w") as file:
        file.create_dataset("ENS_MAA/mesh/NOE/COO", (10**9, 3), "f8", chunks=(10**5, 3), compression="gzip")
    assert path.stat().st_size < 1e5
    refused(path, "arrays of more than 537 MB")
    with h5py.File(path, "w") as file:
        file["ENS_MAA"] = h5py.ExternalLink("/dev/zero", "/")
    refused(path, "refers to another file, '/dev/zero'")
    with h5py.File(path, "w") as file:
        file.create_dataset("ENS_MAA/mesh/NOE/COO", (10, 3), "f8", external=[("/dev/zero", 0, 240)])
    refused(path, "keeps '/ENS_MAA/mesh/NOE/COO' in other files")
    with h5py.File(path, "w") as file:
        file.create_group("ENS_MAA")["round"] = file["/"]
    refused(path)


def edited(tmp_path, old, new):
    text = (MESHES / "stepped.msh").read_text()
    assert old in text
    path = tmp_path / "edited.msh"
    path.write_text(text.replace(old, new, 1))
    return path


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("$Nodes\n5 26 1 26", "$Nodes\n5 26 1 99999999999"),
        ("\n28 26 3", "\n28 99999999999 3"),
        ("$PhysicalNames\n", "$PhysicalNames\n99999999999\n"),
        ("$EndElements\n", "$EndElements\n$NodeData\n99999999999\n$EndNodeData\n"),
        ("$EndElements\n", "$EndElements\n$Periodic\n99999999999999999999999\n$EndPeriodic\n"),
    ],
)
def test_gmsh_counts_and_tags_that_no_file_holds(tmp_path, old, new):
    refused(edited(tmp_path, old, new), "announces 9999", "renumber")


def test_values_of_fields_may_be_large_whole_numbers(tmp_path):
    field = '$NodeData\n1\n"modulus"\n1\n0\n3\n0\n1\n26\n' + "".join(f"{k} 210000000000\n" for k in range(1, 27))
    path = edited(tmp_path, "$EndElements\n", f"$EndElements\n{field}$EndNodeData\n")
    assert vf.Beam.from_mesh(path, 1.0, 1.0).nodes.size - 1 == 25


@pytest.mark.parametrize("kind", ["gmsh", "gmsh22"])
def test_binary_gmsh_files(tmp_path, kind):
    path = tmp_path / "binary.msh"
    meshio.write(path, meshio.read(MESHES / "beam25.msh"), file_format=kind, binary=True)
    assert vf.Beam.from_mesh(path, 1.0, 1.0).nodes.size - 1 == 25
    content = path.read_bytes()
    if kind == "gmsh22":
        at = content.index(b"$Nodes") + len(b"$Nodes\n26\n")
        path.write_bytes(content[:at] + struct.pack("<i", 2**31 - 1) + content[at + 4 :])
        refused(path, "announces 2147483647 as a tag")
        return
    at = content.index(b"$Nodes\n") + 7
    for place, value in ((0, 2**40), (8, 2**62), (44, 2**40), (52, 2**40)):
        path.write_bytes(content[: at + place] + struct.pack("<Q", value) + content[at + place + 8 :])
        refused(path, f"announces {value}")
    at = content.index(b"$Elements\n") + 10
    path.write_bytes(content[: at + 44] + struct.pack("<Q", 2**40) + content[at + 52 :])
    refused(path, f"announces {2**40}")


def test_sparse_files(tmp_path):
    for extension in (".msh", ".vtu", ".med"):
        path = tmp_path / f"sparse{extension}"
        with path.open("wb") as file:
            file.truncate(10**10)
        refused(path, "has 10000 MB")


def test_pipes_and_devices_are_refused_and_do_not_hang(tmp_path):
    for extension in (".msh", ".vtu", ".med"):
        pipe, link = tmp_path / f"pipe{extension}", tmp_path / f"zero{extension}"
        os.mkfifo(pipe)
        link.symlink_to("/dev/zero")
        loop = tmp_path / f"loop{extension}"
        loop.symlink_to(loop)
        for path in (pipe, link, loop):
            caught = []

            def read(path=path, caught=caught):
                with pytest.raises(vf.MeshError) as error:
                    vf.Beam.from_mesh(path, 1.0, 1.0)
                caught.append(str(error.value))

            thread = threading.Thread(target=read, daemon=True)
            thread.start()
            thread.join(10.0)
            assert caught, f"reading {path} hangs"
