"""Beams from mesh files: the same matrices as plain beams, names that work, and typed errors for every bad file."""

import importlib.util
import os
from pathlib import Path

import meshio
import numpy as np
import pytest

import vofem as vf
from vofem.bodies.mesh import read_mesh

MESHES = Path(__file__).parents[1] / "meshes"
UNIFORM = ["beam25.msh", "beam25.vtu", "beam25.med", "inclined.msh"]
CLAMPED = {"left": "clamped"}


def script():
    spec = importlib.util.spec_from_file_location("make_meshes", MESHES / "make_meshes.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def assert_same(a, b, tolerance=1e-13):
    """Compare matrices with slopes measured in element lengths, so that all entries are of one kind."""
    ours, theirs = a.matrices(), b.matrices()
    np.testing.assert_array_equal(ours.supported, theirs.supported)
    scale = 1.0 / theirs.scale
    for x, y in ((ours.mass, theirs.mass), (ours.stiffness, theirs.stiffness)):
        x, y = (matrix.toarray() * scale[:, None] * scale for matrix in (x, y))
        assert np.max(np.abs(x - y)) <= tolerance * np.max(np.abs(y))


def write(path, coordinates, cells, **data):
    meshio.Mesh(np.array(coordinates, dtype=float), cells, **data).write(path)
    return path


def line_file(path, coordinates, lines, **data):
    coordinates = np.array(coordinates, dtype=float)
    if coordinates.ndim == 1:
        coordinates = np.pad(coordinates[:, None], ((0, 0), (0, 2)))
    return write(path, coordinates, [("line", np.array(lines))], **data)


def refusal(path, *words, **arguments):
    """Return the message of the refusal, and check that it names the file."""
    with pytest.raises(vf.MeshError) as caught:
        vf.Beam.from_mesh(path, 1.0, 1.0, **arguments)
    message = str(caught.value)
    assert isinstance(caught.value, vf.VofemError)
    assert isinstance(caught.value, ValueError)
    assert Path(path).name in message
    for word in words:
        assert word in message
    return message


# -- good files ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", UNIFORM)
def test_uniform_meshes_equal_the_plain_beam(name):
    mesh = vf.Beam.from_mesh(MESHES / name, 2.0, 3.0, CLAMPED)
    plain = vf.Beam(1.0, 2.0, 3.0, 25, CLAMPED)
    assert_same(mesh, plain)
    assert mesh.origin == 0.0
    assert mesh.length == pytest.approx(1.0, rel=1e-15)
    a, b = (vf.modes(vf.Scene(bodies=[beam]), 5) for beam in (mesh, plain))
    np.testing.assert_allclose(a.omega, b.omega, rtol=1e-9)
    x = np.linspace(0.0, 1.0, 11)
    for k in range(5):
        np.testing.assert_allclose(np.abs(a.shape(k, x)), np.abs(b.shape(k, x)), atol=1e-8)


def test_graded_mesh_equals_the_plain_beam():
    mesh = vf.Beam.from_mesh(MESHES / "graded.msh", 1.0, 1.0, {"root": "clamped"}, tension=0.5)
    nodes = np.concatenate([[0.0], np.cumsum(0.9 ** np.arange(30))])
    plain = vf.Beam(1.0, 1.0, 1.0, nodes / nodes[-1], CLAMPED, tension=0.5)
    assert_same(mesh, plain)
    np.testing.assert_allclose(mesh.element_lengths[1:] / mesh.element_lengths[:-1], 0.9, rtol=1e-12)


def test_stepped_mesh_equals_the_plain_beam():
    supports = {"root": "clamped", "step": "pinned"}
    mesh = vf.Beam.from_mesh(MESHES / "stepped.msh", {"thin": 1.0, "thick": 8.0}, {"thick": 2.0, "thin": 1.0}, supports)
    nodes = np.concatenate([0.4 * np.arange(11) / 10, 0.4 + 0.6 * np.arange(1, 16) / 15])
    thick = np.arange(25) < 10
    plain = vf.Beam(1.0, np.where(thick, 8.0, 1.0), np.where(thick, 2.0, 1.0), nodes, {0.0: "clamped", 0.4: "pinned"})
    assert_same(mesh, plain)
    assert mesh.supports == {0: "clamped", 10: "pinned"}
    assert mesh.at("step").x == 0.4


def test_named_points_in_a_scene():
    beam = vf.Beam.from_mesh(MESHES / "inclined.msh", 1.0, 1.0, {"root": "clamped"}, name="deck")
    tip = beam.at("tip")
    assert tip.x == pytest.approx(1.0)
    assert beam.at("left").x == beam.at("root").x == 0.0
    assert beam.node_at("tip") == beam.node_at("right") == 25
    scene = vf.Scene(bodies=[beam], effects=[vf.PointLoad(tip, vf.Constant(0.3))])
    assert vf.equilibrium(scene).displacement(tip) == pytest.approx(0.1, rel=1e-9)


def test_callables_take_arc_length_on_an_inclined_beam_and_x_along_x(tmp_path):
    seen = []

    def stiffness(x):
        seen.append((np.min(x), np.max(x)))
        return 1.0 + 0.0 * x

    vf.Beam.from_mesh(MESHES / "inclined.msh", stiffness, 1.0, CLAMPED).matrices()
    assert all(0.0 <= low <= high <= 1.0 for low, high in seen)
    path = line_file(tmp_path / "shifted.vtu", [7.0, 5.0, 6.0], [[0, 2], [1, 2]])
    beam = vf.Beam.from_mesh(path, 1.0, 1.0)
    np.testing.assert_array_equal(beam.nodes, [5.0, 6.0, 7.0])
    assert beam.at("left").x == 5.0


@pytest.mark.parametrize("seed", range(5))
def test_any_order_of_nodes_and_direction_of_lines(tmp_path, seed):
    rng = np.random.default_rng(seed)
    n = 12
    number = rng.permutation(n + 3)  # three nodes that nothing uses
    coordinates = np.full((n + 3, 3), np.nan if seed % 2 else 9.0)
    x = np.sort(rng.uniform(size=n))
    coordinates[number[:n]] = np.stack([0 * x, x, 2 * x], axis=1)
    lines = np.stack([number[: n - 1], number[1:n]], axis=1)
    lines = np.where(rng.uniform(size=(n - 1, 1)) < 0.5, lines, lines[:, ::-1])[rng.permutation(n - 1)]
    tip = np.zeros(n + 3, dtype=int)
    tip[number[n - 1]] = 1
    half = (coordinates[lines].mean(axis=1)[:, 1] < x[5]).astype(int)
    data = {"point_data": {"tip": tip}, "cell_data": {"lower": [half], "upper": [1 - half]}}
    path = line_file(tmp_path / "mixed.vtu", coordinates, lines, **data)
    beam = vf.Beam.from_mesh(path, {"lower": 3.0, "upper": 1.0}, 1.0, {"tip": "clamped"})
    arc = np.sqrt(5.0) * (x - x[0])
    assert_same(beam, vf.Beam(arc[-1], np.where(np.arange(n - 1) < 5, 3.0, 1.0), 1.0, arc, {"right": "clamped"}), 1e-9)


@pytest.mark.parametrize(
    ("first", "last"),
    [((0, 0, 0), (-1, 5, 5)), ((0, 1, 0), (0, -1, 2)), ((1, 1, 3), (1, 1, 2)), ((1e-12, 3, 0), (0, 2, 0))],
)
def test_the_left_end_has_the_smaller_x_then_y_then_z(tmp_path, first, last):
    point = np.array([1, 0])
    for k, ends in enumerate(((first, last), (last, first))):
        mark = {"end": point if k else point[::-1]}
        path = line_file(tmp_path / "ends.vtu", ends, [[0, 1]], point_data=mark)
        beam = vf.Beam.from_mesh(path, 1.0, 1.0)
        assert beam.node_at("end") == 0


def test_far_from_the_origin_lengths_are_differences(tmp_path):
    offset = 2.0**20
    x = np.arange(33) / 32
    path = line_file(tmp_path / "far.vtu", offset * np.ones((33, 3)) + x[:, None] * [0, 3.0, 4.0], chain_of(33))
    beam = vf.Beam.from_mesh(path, 1.0, 1.0, CLAMPED)
    assert_same(beam, vf.Beam(5.0, 1.0, 1.0, 32, CLAMPED))
    path = line_file(tmp_path / "far.vtu", 1e6 + x / 1000, chain_of(33))
    assert vf.Beam.from_mesh(path, 1.0, 1.0, {"right": "clamped"}).supports == {32: "clamped"}


def chain_of(n):
    return np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)


def test_a_set_of_several_points_serves_in_supports_only(tmp_path):
    data = {"point_data": {"piers": np.array([1, 0, 1, 1])}}
    path = line_file(tmp_path / "piers.vtu", [0.0, 1.0, 2.0, 3.0], chain_of(4), **data)
    beam = vf.Beam.from_mesh(path, 1.0, 1.0, {"piers": "pinned"})
    assert beam.supports == {0: "pinned", 2: "pinned", 3: "pinned"}
    with pytest.raises(vf.ArgumentError, match=r"names 3 nodes \(x = 0, 2, 3 m\)"):
        beam.at("piers")


def test_coordinates_in_a_plane_and_other_data_are_fine(tmp_path):
    data = {"point_data": {"temperature": np.array([0.0, 1.0, 0.0])}, "cell_data": {"gmsh:physical": [np.ones(2, int)]}}
    mesh = meshio.Mesh(np.array([[0.0, 0.0], [3.0, 4.0], [6.0, 8.0]]), [("line", chain_of(3))])
    meshio.write(tmp_path / "plane.med", mesh)
    assert vf.Beam.from_mesh(tmp_path / "plane.med", 1.0, 1.0).length == 10.0
    beam = vf.Beam.from_mesh(line_file(tmp_path / "data.vtu", [0.0, 1.0, 2.0], chain_of(3), **data), 1.0, 1.0)
    assert not beam.mesh.points
    assert not beam.mesh.subdomains


def test_lines_given_twice_count_once(tmp_path):
    path = line_file(tmp_path / "twice.vtu", [0.0, 1.0, 2.0], [[0, 1], [1, 2], [2, 1]])
    assert vf.Beam.from_mesh(path, 1.0, 1.0).element_lengths.size == 2


def test_binary_gmsh_and_format_2(tmp_path):
    mesh = meshio.read(MESHES / "stepped.msh")
    mesh.cell_sets = {}
    values = {"thick": 2.0, "thin": 1.0}
    plain = vf.Beam.from_mesh(MESHES / "stepped.msh", values, 1.0, {"step": "pinned"})
    for name, kind in (("binary.msh", "gmsh"), ("two.msh", "gmsh22")):
        meshio.write(tmp_path / name, mesh, file_format=kind)
        assert_same(vf.Beam.from_mesh(tmp_path / name, values, 1.0, {"step": "pinned"}), plain)


def test_vertices_and_groups_name_points_in_med(tmp_path):
    mesh = meshio.Mesh(
        np.array([[0.0], [1.0], [2.0]]) * [1.0, 0.0, 0.0],
        [("vertex", [[1]]), ("line", chain_of(3))],
        cell_data={"cell_tags": [np.array([-1]), np.array([-2, -3])]},
    )
    mesh.cell_tags = {-1: ["middle"], -2: ["a", "all"], -3: ["b", "all"]}
    meshio.write(tmp_path / "groups.med", mesh)
    beam = vf.Beam.from_mesh(tmp_path / "groups.med", {"a": 1.0, "b": 2.0}, {"all": 3.0})
    assert beam.at("middle").x == 1.0
    np.testing.assert_array_equal(beam.EI, [1.0, 2.0])
    np.testing.assert_array_equal(beam.rhoA, [3.0, 3.0])


def test_the_script_makes_the_files_that_are_here(tmp_path):
    script().main(tmp_path)
    made = sorted(path.name for path in tmp_path.iterdir())
    assert made == sorted(path.name for path in MESHES.iterdir() if path.suffix in (".msh", ".vtu", ".med"))
    for name in made:
        if name.endswith(".med"):  # the bytes depend on the version of HDF5
            a, b = read_mesh(tmp_path / name), read_mesh(MESHES / name)
            np.testing.assert_array_equal(a.arc, b.arc)
            assert {k: v.tolist() for k, v in a.points.items()} == {k: v.tolist() for k, v in b.points.items()}
            assert list(a.subdomains) == list(b.subdomains) == ["beam"]
        else:
            assert (tmp_path / name).read_bytes() == (MESHES / name).read_bytes()


# -- names --------------------------------------------------------------------------------------------


def test_unknown_names_say_the_nearest():
    path = MESHES / "stepped.msh"
    with pytest.raises(vf.ArgumentError, match="did you mean 'thick'"):
        vf.Beam.from_mesh(path, {"thikc": 1.0, "thin": 1.0}, 1.0)
    with pytest.raises(vf.ArgumentError, match="did you mean 'root'"):
        vf.Beam.from_mesh(path, 1.0, 1.0, {"rot": "clamped"})
    beam = vf.Beam.from_mesh(path, 1.0, 1.0)
    with pytest.raises(vf.ArgumentError, match="'left', 'right', 'root', 'step', 'tip'"):
        beam.at("top of it all")
    with pytest.raises(vf.ArgumentError, match="only a beam from a mesh"):
        vf.Beam(1.0, {"thick": 1.0}, 1.0, 5)


def test_subdomains_must_cover_every_element_once(tmp_path):
    path = MESHES / "stepped.msh"
    with pytest.raises(vf.ArgumentError, match=r"no value for element 10, from 0.4 to 0.44 m: give a value for 'thin'"):
        vf.Beam.from_mesh(path, {"thick": 1.0}, 1.0)
    with pytest.raises(vf.ArgumentError, match=r"'thin' is -1.0, expected a positive number"):
        vf.Beam.from_mesh(path, {"thick": 1.0, "thin": -1.0}, 1.0)
    data = {"cell_data": {"a": [np.array([1, 1, 0])], "b": [np.array([0, 1, 0])]}}
    path = line_file(tmp_path / "part.vtu", [0.0, 1.0, 2.0, 3.0], chain_of(4), **data)
    with pytest.raises(vf.ArgumentError, match="'a' and 'b' overlap in element 1, from 1 to 2 m"):
        vf.Beam.from_mesh(path, {"a": 1.0, "b": 2.0}, 1.0)
    with pytest.raises(vf.ArgumentError, match="no named subdomain of the mesh holds it"):
        vf.Beam.from_mesh(path, {"a": 1.0}, 1.0)
    with pytest.raises(vf.ArgumentError, match="the mesh has no named subdomain"):
        vf.Beam.from_mesh(line_file(tmp_path / "bare.vtu", [0.0, 1.0], [[0, 1]]), {"a": 1.0}, 1.0)


def test_one_node_has_one_support():
    path = MESHES / "beam25.msh"
    assert vf.Beam.from_mesh(path, 1.0, 1.0, {"left": "pinned", "root": "pinned"}).supports == {0: "pinned"}
    with pytest.raises(vf.ArgumentError, match="under another name"):
        vf.Beam.from_mesh(path, 1.0, 1.0, {"left": "pinned", "root": "clamped"})
    with pytest.raises(vf.ArgumentError, match="under another name"):
        vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned", 0.0: "guided"})


def test_a_support_between_nodes_names_the_cure():
    with pytest.raises(vf.ArgumentError, match=r"nearest are 0.48 and 0.52 m. Put a node there in the mesh"):
        vf.Beam.from_mesh(MESHES / "beam25.msh", 1.0, 1.0, {0.5: "pinned"})


def test_what_gmsh_writes_besides(tmp_path):
    """As Gmsh writes: boxes with a margin, points without a group, a curve in two groups, a reversed curve."""
    text = """$MeshFormat
4.1 0 8
$EndMeshFormat
$PhysicalNames
4
0 1 "fixed ends"
0 2 "load:point"
1 3 "all"
1 4 "outer"
$EndPhysicalNames
$Entities
3 2 0 0
7 0 0 0 1 1
8 2 0 0 0
9 5 0 0 2 1 2
4 -1e-07 -1e-07 -1e-07 2.0000001 1e-07 1e-07 1 3 2 8 -7
6 2 0 0 5 0 0 2 3 4 2 8 -9
$EndEntities
$Nodes
5 6 10 40
0 7 0 1
10
0 0 0
0 8 0 1
40
2 0 0
0 9 0 1
20
5 0 0
1 4 0 2
31
32
1.5 0 0
0.5 0 0
1 6 0 1
33
3 0 0
$EndNodes
$Elements
4 7 1 7
0 7 15 1
1 10
0 9 15 1
2 20
1 4 1 3
3 40 31
4 31 32
5 32 10
1 6 1 2
6 40 33
7 33 20
$EndElements
"""
    path = tmp_path / "layout.msh"
    path.write_text(text)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.arc, [0.0, 0.5, 1.5, 2.0, 3.0, 5.0])
    assert {name: nodes.tolist() for name, nodes in mesh.points.items()} == {"fixed ends": [0, 5], "load:point": [5]}
    assert {name: lines.tolist() for name, lines in mesh.subdomains.items()} == {"all": [*range(5)], "outer": [3, 4]}


def test_left_and_right_in_the_mesh_must_be_the_ends(tmp_path):
    for marks, good in (([1, 0, 0], True), ([0, 1, 0], False), ([0, 0, 1], False), ([1, 0, 1], False)):
        path = line_file(tmp_path / "l.vtu", [0.0, 1.0, 2.0], chain_of(3), point_data={"left": np.array(marks)})
        if good:
            assert vf.Beam.from_mesh(path, 1.0, 1.0).node_at("left") == 0
        else:
            refusal(path, "'left' is not the left end", "give it another name")


def test_a_set_off_the_beam_says_so(tmp_path):
    data = {"point_data": {"tip": np.array([0, 0, 1])}}
    beam = vf.Beam.from_mesh(line_file(tmp_path / "off.vtu", [0.0, 1.0, 2.0], [[0, 1]], **data), 1.0, 1.0)
    with pytest.raises(vf.ArgumentError, match="names no node of the beam"):
        beam.at("tip")


# -- bad files ----------------------------------------------------------------------------------------


def test_files_that_are_not_there(tmp_path):
    refusal(tmp_path / "nothing.msh", "does not exist")
    (tmp_path / "folder.msh").mkdir()
    refusal(tmp_path / "folder.msh", "is a directory")
    (tmp_path / "beam.xyz").write_text("beam")
    refusal(tmp_path / "beam.xyz", "'.xyz'", ".msh, .vtu, .med", "meshio convert")
    (tmp_path / "beam").write_text("beam")
    refusal(tmp_path / "beam", "extension ''")
    for path in (None, 3, b"beam.msh"):
        with pytest.raises(vf.ArgumentError, match="expected the name of a mesh file"):
            vf.Beam.from_mesh(path, 1.0, 1.0)


@pytest.mark.parametrize("extension", [".msh", ".vtu", ".med"])
def test_empty_and_garbage(tmp_path, extension, capfd):
    path = tmp_path / f"bad{extension}"
    path.write_bytes(b"")
    refusal(path, "is empty")
    rng = np.random.default_rng(1)
    for content in (rng.bytes(5000), b"\n\n\n", b"$MeshFormat\n" + rng.bytes(300), b"<VTKFile/>", b"\x89HDF\r\n\x1a\n"):
        path.write_bytes(content)
        refusal(path)
    for other in {"beam25.msh", "beam25.vtu", "beam25.med"} - {f"beam25{extension}"}:
        path.write_bytes((MESHES / other).read_bytes())
        refusal(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["beam25.msh", "stepped.msh", "beam25.vtu", "beam25.med"])
def test_truncated_anywhere(tmp_path, name, capfd):
    content = (MESHES / name).read_bytes()
    content = content.rstrip() if not name.endswith(".med") else content
    path = tmp_path / name
    step = 1 if name == "stepped.msh" else max(1, len(content) // 60)
    for size in range(1, len(content), step):
        path.write_bytes(content[:size])
        refusal(path)
    assert capfd.readouterr() == ("", "")


def test_damaged_anywhere_is_a_beam_or_a_typed_error(tmp_path, capfd):
    rng = np.random.default_rng(0)
    for name in ("beam25.msh", "beam25.vtu"):
        content = bytearray((MESHES / name).read_bytes())
        path = tmp_path / name
        for _ in range(150):
            damaged = content.copy()
            damaged[int(rng.integers(len(content)))] = int(rng.choice(list(b"-.x $7\n\xff")))
            path.write_bytes(damaged)
            try:
                vf.Beam.from_mesh(path, 1.0, 1.0)
            except vf.MeshError as error:
                assert name in str(error)  # noqa: PT017
    assert capfd.readouterr() == ("", "")


def edited(tmp_path, *pairs):
    text = (MESHES / "stepped.msh").read_text()
    for old, new in pairs:
        assert old in text
        text = text.replace(old, new, 1)
    path = tmp_path / "edited.msh"
    path.write_text(text)
    return path


def test_gmsh_files_that_contradict_themselves(tmp_path):
    refusal(edited(tmp_path, ('"thin"', '"root"')), "'root' to 2 groups", "name of its own")
    refusal(edited(tmp_path, ("0.4 0.0 0.0", "nan 0.0 0.0"), ("\n0.4 0.0 0.0", "\nnan 0.0 0.0")), "not a finite number")
    refusal(edited(tmp_path, ("$Nodes\n5 26 1 26", "$Nodes\n5 99999999999 1 26")), "announces 99999999999 nodes")
    refusal(edited(tmp_path, ("\n28 26 3", "\n28 77 3")), "Write it again")
    refusal(edited(tmp_path, ("1 4 2 1 -2 ", "0 2 1 -2 ")), "all cells or to none", "SaveAll")
    refusal(edited(tmp_path, ("4.1 0 8", "9.9 0 8")), "9.9")


def test_where_meshio_ends_the_process_an_error_is_raised(tmp_path, capfd):
    path = edited(tmp_path, ("0 1 0 1\n", "0 1 1 1\n"))
    with pytest.raises(SystemExit):
        meshio.read(path, file_format="gmsh")
    assert "parametric" in capfd.readouterr().out
    refusal(path, "parametric nodes not implemented")
    assert capfd.readouterr() == ("", "")


def test_wrong_cells(tmp_path):
    square = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
    triangles = ("triangle", [[0, 1, 2], [0, 2, 3]])
    refusal(write(tmp_path / "t.vtu", square, [triangles]), "2 triangle", "gmsh -1")
    refusal(write(tmp_path / "m.vtu", square, [("line", [[0, 1]]), triangles]), "1 line, 2 triangle")
    refusal(write(tmp_path / "q.med", square, [("quad", [[0, 1, 2, 3]])]), "1 quad")
    refusal(write(tmp_path / "v.vtu", square, [("vertex", [[0]])]), "1 vertex", "expected two-node lines")
    three = write(tmp_path / "three.vtu", [[0, 0, 0], [1, 0, 0], [0.5, 0, 0]], [("line3", [[0, 1, 2]])])
    refusal(three, "1 line3", "higher order", "ElementOrder")


def test_lines_that_make_no_beam(tmp_path):
    path = tmp_path / "lines.vtu"
    corner = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]]
    refusal(line_file(path, corner, [[0, 1], [1, 2], [1, 3]]), "branches at (1, 0, 0)", "3 elements")
    refusal(line_file(path, corner, [[0, 1], [1, 3], [3, 0]]), "closed loop")
    refusal(line_file(path, corner, [[0, 1], [1, 3]]), "not straight", "m off the line", "one Beam for each")
    refusal(line_file(path, [0.0, 2.0, 1.0], chain_of(3)), "folds back")
    refusal(line_file(path, [0.0, 1.0, 0.0], chain_of(3)), "not straight", "is both its ends")
    refusal(line_file(path, [0.0, 1.0, 2.0, 3.0], [[0, 1], [2, 3]]), "not connected", "1 of 2", "file of its own")
    refusal(line_file(path, [0.0, 1.0, 1.0, 2.0], [[0, 1], [2, 3]]), "not connected", "merge duplicate nodes")
    loop = [*corner, [5, 0, 0], [6, 0, 0]]
    refusal(line_file(path, loop, [[0, 1], [1, 3], [3, 0], [4, 5]]), "not connected", "1 of 4")
    refusal(line_file(path, [0.0, 1.0, 1.0, 2.0], chain_of(4)), "no length", "merge duplicate nodes")
    refusal(line_file(path, [1.0, 1.0], [[0, 1]]), "no length")
    refusal(line_file(path, [0.0, 1.0], [[0, 1], [1, 1]]), "with itself")
    refusal(line_file(path, [0.0, np.nan, 1.0], chain_of(3)), "not a finite number")
    refusal(line_file(path, [0.0, np.inf], [[0, 1]]), "not a finite number")
    refusal(line_file(path, [0.0, 1.0], [[0, 7]]), "names node 7")
    refusal(line_file(path, [0.0, 1.0], [[0, -1]]), "names node -1")


def test_nearly_straight_is_straight(tmp_path):
    x = np.linspace(0.0, 1.0, 21)
    single = np.stack([x, 2 * x, -x], axis=1).astype(np.float32)
    assert vf.Beam.from_mesh(line_file(tmp_path / "s.vtu", single, chain_of(21)), 1.0, 1.0).length > 2.4
    bent = np.stack([x, 1e-4 * x * (1 - x), 0 * x], axis=1)
    refusal(line_file(tmp_path / "b.vtu", bent, chain_of(21)), "not straight")


def test_many_loose_lines_are_refused_fast(tmp_path):
    n = 20_000
    refusal(line_file(tmp_path / "loose.vtu", np.arange(2.0 * n), np.arange(2 * n).reshape(n, 2)), "not connected")


def test_compressed_and_binary_files_are_read(tmp_path):
    mesh = meshio.read(MESHES / "beam25.vtu")
    for compression in ("zlib", "lzma", None):
        meshio.write(tmp_path / "beam.vtu", mesh, compression=compression)
        assert vf.Beam.from_mesh(tmp_path / "beam.vtu", 1.0, 1.0).length == pytest.approx(1.0)
    for kind in ("gmsh", "gmsh22"):
        meshio.write(tmp_path / "beam.msh", meshio.read(MESHES / "beam25.msh"), file_format=kind, binary=True)
        assert vf.Beam.from_mesh(tmp_path / "beam.msh", 1.0, 1.0).nodes.size - 1 == 25


def test_large_files_and_those_that_do_not_fit_into_memory(tmp_path, monkeypatch):
    with (tmp_path / "sparse.vtu").open("wb") as file:
        file.truncate(10**10)
    refusal(tmp_path / "sparse.vtu", "has 10000 MB", "Export the axis alone")

    def read(*_arguments, **_options):
        raise MemoryError("3 TB")

    monkeypatch.setattr(meshio, "read", read)
    refusal(MESHES / "beam25.vtu", "does not fit into memory (3 TB)", "Renumber")


def test_pipes_and_devices_are_refused_and_do_not_hang(tmp_path):
    pipe, link, loop = (tmp_path / f"{name}.msh" for name in ("pipe", "zero", "loop"))
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    loop.symlink_to(loop)
    for path in (pipe, link, loop):
        refusal(path)
