"""Make the mesh files of this directory: ``python meshes/make_meshes.py [directory]``.

Every file holds a straight beam of 1 m with the named points "root" and "tip".
As Gmsh does it, the points of the geometry are numbered first and the nodes
inside of the curves after them, so the numbers do not follow the axis.

==============  ==================================================================
beam25.msh      25 equal elements on 0 <= x <= 1, curve "beam"; the reference
beam25.vtu      the same; names are arrays of 0 and 1
beam25.med      the same; names are groups
graded.msh      30 elements, each 0.9 of the one before: fine at the tip
stepped.msh     curves "thick" (0 to 0.4 m, 10 elements) and "thin" (15 elements),
                with the point "step" between them
inclined.msh    25 equal elements in space, from (0.3, -0.2, 0.5) along (2, 1, -2)
==============  ==================================================================
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: A curve: its name, and the coordinates of its nodes from end to end, shape (k, 3).
Curves = list[tuple[str, Array]]


def along_x(x: Array) -> Array:
    """Return points on the x axis, shape (k, 3)."""
    return np.stack([x, 0.0 * x, 0.0 * x], axis=1)


def number_nodes(curves: Curves) -> tuple[Array, list[list[int]]]:
    """Return coordinates and the nodes of each curve, counted from 0: end points first, then each curve's inside."""
    ends = [curves[0][1][0]] + [nodes[-1] for _, nodes in curves]
    coordinates = list(ends)
    numbers = []
    for k, (_, nodes) in enumerate(curves):
        inside = list(range(len(coordinates), len(coordinates) + len(nodes) - 2))
        coordinates.extend(nodes[1:-1])
        numbers.append([k, *inside, k + 1])
    return np.array(coordinates), numbers


def gmsh(curves: Curves, points: list[str]) -> str:
    """Return a Gmsh 4.1 file: one physical group for each curve and for each point between and at its ends."""
    coordinates, numbers = number_nodes(curves)
    spell = [" ".join(repr(float(value)) for value in node) for node in coordinates]
    out = ["$MeshFormat", "4.1 0 8", "$EndMeshFormat", "$PhysicalNames", str(len(points) + len(curves))]
    out += [f'0 {k} "{name}"' for k, name in enumerate(points, 1)]
    out += [f'1 {k} "{name}"' for k, (name, _) in enumerate(curves, len(points) + 1)]
    out += ["$EndPhysicalNames", "$Entities", f"{len(points)} {len(curves)} 0 0"]
    out += [f"{k} {spell[k - 1]} 1 {k} " for k in range(1, len(points) + 1)]
    for k, (_, nodes) in enumerate(curves, 1):
        low, high = nodes.min(axis=0), nodes.max(axis=0)
        box = " ".join(repr(float(value)) for value in (*low, *high))
        out.append(f"{k} {box} 1 {len(points) + k} 2 {k} -{k + 1} ")
    total = len(coordinates)
    out += ["$EndEntities", "$Nodes", f"{len(points) + len(curves)} {total} 1 {total}"]
    for k in range(1, len(points) + 1):
        out += [f"0 {k} 0 1", str(k), spell[k - 1]]
    for k, nodes in enumerate(numbers, 1):
        inside = nodes[1:-1]
        out += [f"1 {k} 0 {len(inside)}", *(str(node + 1) for node in inside), *(spell[node] for node in inside)]
    elements = len(points) + sum(len(nodes) - 1 for nodes in numbers)
    out += ["$EndNodes", "$Elements", f"{len(points) + len(curves)} {elements} 1 {elements}"]
    for k in range(1, len(points) + 1):
        out += [f"0 {k} 15 1", f"{k} {k} "]
    element = len(points)
    for k, nodes in enumerate(numbers, 1):
        out.append(f"1 {k} 1 {len(nodes) - 1}")
        for a, b in pairwise(nodes):
            element += 1
            out.append(f"{element} {a + 1} {b + 1} ")
    return "\n".join([*out, "$EndElements", ""])


def vtu(curves: Curves, points: list[str]) -> str:
    """Return a VTU file in ASCII: each name is an integer array that is 1 on the nodes or elements it means."""
    coordinates, numbers = number_nodes(curves)
    lines = [pair for nodes in numbers for pair in pairwise(nodes)]

    def data(kind: str, name: str, values: list[str], components: str = "") -> list[str]:
        return [f'<DataArray type="{kind}" Name="{name}"{components} format="ascii">', *values, "</DataArray>"]

    out = ['<?xml version="1.0"?>', '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">']
    out += ["<UnstructuredGrid>", f'<Piece NumberOfPoints="{len(coordinates)}" NumberOfCells="{len(lines)}">']
    spell = [" ".join(repr(float(value)) for value in node) for node in coordinates]
    out += ["<Points>", *data("Float64", "Points", spell, ' NumberOfComponents="3"'), "</Points>", "<Cells>"]
    out += data("Int64", "connectivity", [f"{a} {b}" for a, b in lines])
    out += data("Int64", "offsets", [" ".join(str(2 * k) for k in range(1, len(lines) + 1))])
    out += data("Int64", "types", [" ".join("3" for _ in lines)])
    out += ["</Cells>", "<PointData>"]
    for k, name in enumerate(points):
        out += data("Int64", name, [" ".join(str(int(node == k)) for node in range(len(coordinates)))])
    out += ["</PointData>", "<CellData>"]
    for k, (name, _) in enumerate(curves):
        marks = [str(int(j == k)) for j, nodes in enumerate(numbers) for _ in nodes[1:]]
        out += data("Int64", name, [" ".join(marks)])
    return "\n".join([*out, "</CellData>", "</Piece>", "</UnstructuredGrid>", "</VTKFile>", ""])


def write_med(path: Path, curves: Curves, points: list[str]) -> None:
    """Write a MED file: node families are numbered from 1 upward, element families from -1 downward."""
    import meshio

    coordinates, numbers = number_nodes(curves)
    lines = [pair for nodes in numbers for pair in pairwise(nodes)]
    node_family = np.zeros(len(coordinates), dtype=np.int64)
    node_family[: len(points)] = np.arange(1, len(points) + 1)
    line_family = np.concatenate([np.full(len(nodes) - 1, -k) for k, nodes in enumerate(numbers, 1)])
    mesh = meshio.Mesh(
        coordinates, [("line", lines)], point_data={"point_tags": node_family}, cell_data={"cell_tags": [line_family]}
    )
    mesh.point_tags = {k: [name] for k, name in enumerate(points, 1)}
    mesh.cell_tags = {-k: [name] for k, (name, _) in enumerate(curves, 1)}
    meshio.write(path, mesh, file_format="med")


def main(directory: Path) -> None:
    """Write all files."""
    uniform = np.arange(26) / 25
    beam = [("beam", along_x(uniform))]
    graded = np.concatenate([[0.0], np.cumsum(0.9 ** np.arange(30))])
    graded = graded / graded[-1]
    stepped = [("thick", along_x(0.4 * np.arange(11) / 10)), ("thin", along_x(0.4 + 0.6 * np.arange(16) / 15))]
    axis = np.array([2.0, 1.0, -2.0]) / 3.0
    inclined = np.array([0.3, -0.2, 0.5]) + uniform[:, None] * axis
    ends = ["root", "tip"]
    texts = {
        "beam25.msh": gmsh(beam, ends),
        "beam25.vtu": vtu(beam, ends),
        "graded.msh": gmsh([("beam", along_x(graded))], ends),
        "stepped.msh": gmsh(stepped, ["root", "step", "tip"]),
        "inclined.msh": gmsh([("beam", inclined)], ends),
    }
    directory.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        (directory / name).write_text(text, encoding="ascii", newline="\n")
    write_med(directory / "beam25.med", beam, ends)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent)
