"""Pictures: they show something, they differ where the motion does, and they never leave half a file."""

import matplotlib.image
import numpy as np
import pytest
from scenes import WRONG_SIZES, cantilever, on_stop, paper_beam

import vofem as vf
from vofem.io.pictures import axes as picture_axes
from vofem.io.pictures.layout import arrange
from vofem.io.pictures.places import along_beam, between_masses
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import snapshot
from vofem.io.pictures.units import nice_above, nice_below, spell
from vofem.io.plot import shapes, space_time, time_history
from vofem.io.render import render

ORANGE = np.array([0xE0, 0x7B, 0x21]) / 255.0


def pixels(path):
    return matplotlib.image.imread(path)[..., :3]


def orange(image):
    """Number of pixels in the colour of a closed contact."""
    return int(np.sum(np.all(np.abs(image - ORANGE) < 0.03, axis=-1)))


@pytest.fixture(scope="module")
def paper():
    beam, scene = paper_beam("displacement")
    return beam, vf.simulate(scene, 6.0)


def two_beams():
    lower = cantilever(10, name="lower")
    upper = vf.Beam(1.2, 2.0, 1.0, 12, supports={"left": "pinned", "right": "guided"}, name="upper")
    contact = vf.Contact(lower.at(1.0), upper.at(0.6), gap=0.02, stiffness=50.0, acts_on="penetration", name="c")
    return vf.Scene([lower, upper], [contact, vf.PointLoad(lower.at(1.0), vf.Constant(0.3))])


def two_masses():
    a, b = vf.Mass(1.0, stiffness=100.0, name="a"), vf.Mass(2.0, stiffness=50.0, name="b")
    contact = vf.Contact(a, b, gap=0.01, stiffness=1e3, acts_on="penetration", name="c")
    return vf.Scene([a, b], [contact, vf.PointLoad(a, vf.Constant(3.0))])


def two_sided(load):
    beam = vf.Beam(2.0, 10.0, 1.0, 16, supports={"left": "pinned", "right": "pinned"})
    stops = [
        vf.Contact(beam.at(1.0), gap=0.01, stiffness=1e3, side=side, acts_on="penetration", name=side)
        for side in ("below", "above")
    ]
    return vf.Scene([beam], [*stops, vf.PointLoad(beam.at(1.0), vf.Constant(load))])


def chain():
    beam = vf.Beam(3.0, 100.0, 2.0, 6, supports={"left": "clamped", 1.5: "pinned", "right": "guided"}, name="deck")
    a, b, c = vf.Mass(1.0, 50.0, name="a"), vf.Mass(1.0, 20.0, name="b"), vf.Mass(1.0, 5.0, name="c")
    links = [
        vf.Contact(p, q, gap=0.005, stiffness=1e3, acts_on="penetration", name=f"{k}")
        for k, (p, q) in enumerate([(beam.at(1.0), a), (a, b), (b, c)])
    ]
    return vf.Scene([beam, a, b, c], [*links, vf.Spring(beam.at(2.0), stiffness=10.0), vf.PointLoad(a, vf.Constant(2))])


def test_open_and_closed_differ(paper, tmp_path):
    _, result = paper
    closed = pixels(render(result, 4.0, tmp_path / "closed.png"))
    opened = pixels(render(result, 0.75, tmp_path / "open.png"))
    for image in (closed, opened):
        assert image.shape == (700, 1600, 3)
        assert image.std() > 0.05
        assert np.all(image[:8] == 1.0)
        assert np.all(image[:, :8] == 1.0)
        assert np.all(image[:, -8:] == 1.0)
    assert np.mean(np.any(np.abs(closed - opened) > 0.1, axis=-1)) > 0.02
    assert orange(closed) > 200
    assert orange(opened) < 20
    # The stop is at the right end and below.
    rows, columns = np.nonzero(np.all(np.abs(closed - ORANGE) < 0.03, axis=-1))
    assert rows.min() > 400
    assert columns.min() > 1300


@pytest.mark.parametrize(
    ("build", "contact"),
    [
        (two_beams, True),
        (two_masses, True),
        (lambda: two_sided(-30.0), True),
        (lambda: two_sided(0.1), False),
        (chain, None),
    ],
)
def test_other_scenes_draw(build, contact, tmp_path):
    scene = build()
    image = pixels(render(vf.equilibrium(scene), None, tmp_path / "a.png", scene=scene))
    assert image.std() > 0.03
    if contact is not None:
        assert (orange(image) > 200) is contact


def test_stop_above_pushes_from_above(tmp_path):
    heights = []
    for load in (-30.0, 30.0):
        scene = two_sided(load)
        image = pixels(render(vf.equilibrium(scene), None, tmp_path / "a.png", scene=scene))
        heights.append(float(np.nonzero(np.all(np.abs(image - ORANGE) < 0.03, axis=-1))[0].mean()))
    assert heights[0] > heights[1] + 100


@pytest.mark.parametrize("build", [two_beams, two_masses, chain])
def test_labels_keep_apart_and_inside(build):
    scene = build()
    view = snapshot(vf.equilibrium(scene), None, scene)
    boxes = [label.box for label in sketch(view, (1600, 700), None).labels]
    for k, (left, bottom, right, top) in enumerate(boxes):
        assert 0 <= left < right <= 1600
        assert 0 <= bottom < top <= 700
        for other in boxes[:k]:
            assert left >= other[2] or other[0] >= right or bottom >= other[3] or other[1] >= top


@pytest.mark.parametrize("make", [
    lambda at: vf.BilinearSpring(at, stiffness=50.0, linear_limit=0.01),
    lambda at: vf.HystereticSpring(at, stiffness=50.0, linear_limit=0.01, memory="cyclic"),
    lambda at: vf.Springpot(at, coefficient=1.0, order=0.5),
    lambda at: vf.NonlinearSpring(at, potential=lambda u: u**4, force=lambda u: 4.0 * u**3),
    lambda at: vf.Foundation(at.body, stiffness=50.0),
])  # fmt: skip
def test_whatever_holds_a_beam_is_drawn(make):
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned"}, name="beam")
    effect = make(beam.at(1.0))
    result = vf.simulate(vf.Scene([beam], [effect, vf.PointLoad(beam.at(0.5), 0.1)]), 0.2)
    links = snapshot(result, 0.1).links
    places = [link.a.x for link in links]
    assert places == ([0.25, 0.5, 0.75, 1.0] if isinstance(effect, vf.Foundation) else [1.0])
    assert {link.status for link in links} == {"spring"}
    drawing = sketch(snapshot(result, 0.1), (1600, 700), None)
    assert len(drawing.lines) >= len(sketch(snapshot(bare(beam), 0.1), (1600, 700), None).lines) + len(links)


def bare(beam):
    return vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(0.5), 0.1)]), 0.2)


def test_lower_body_of_a_contact_is_below():
    scene = two_beams()
    view = snapshot(vf.equilibrium(scene), None, scene)
    layout = arrange(view, (1600, 700), None)
    lower, upper = scene.bodies
    assert layout.lanes[lower].axis < layout.lanes[upper].axis
    assert layout.along(lower, 1.0) == pytest.approx(float(layout.along(upper, 0.6)))


def test_time_history(paper, tmp_path):
    beam, result = paper
    for name, contact in (("auto", None), ("named", "stop"), ("none", ())):
        image = pixels(time_history(result, beam.at(1.0), tmp_path / f"{name}.png", contact=contact))
        assert image.std() > 0.05
        assert (orange(image) > 200) is (name != "none")


def test_time_history_of_several_points_and_runs(tmp_path):
    scene = two_masses()
    result = vf.simulate(scene, 3.0)
    one = pixels(time_history(result, scene.bodies, tmp_path / "one.png"))
    assert orange(one) > 200
    other = vf.simulate(two_masses(), 2.0)
    both = pixels(time_history({"first": result, "cost $": other}, list(scene.bodies), tmp_path / "both.png"))
    assert both.shape[1] > one.shape[1]
    with pytest.raises(vf.ArgumentError, match="point is 3"):
        time_history(result, 3.0, tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match="envelope is 'no', expected True or False, or None to draw it where"):
        time_history(result, scene.bodies, tmp_path / "a.png", envelope="no")
    with pytest.raises(vf.ArgumentError, match="points is empty"):
        time_history(result, [], tmp_path / "a.png")


@pytest.fixture
def figures(monkeypatch):
    """Figures of matplotlib that were to be written."""
    found = []
    monkeypatch.setattr(picture_axes, "save", lambda figure, goal: found.append(figure) or goal)
    return found


def stops(*stiffnesses):
    """Runs of one beam against stops of several stiffnesses, by these."""
    runs = {}
    for stiffness in stiffnesses:
        beam = cantilever(4, name="beam")
        scene = on_stop(beam.at(1.0), load=-0.1, gap=0.01, stiffness=stiffness, side="below")[1]
        runs[f"{stiffness:g}"] = vf.simulate(scene, 2.0)
    return beam, runs


@pytest.mark.parametrize(("stiffnesses", "labels", "tops"), [
    ((2.0, 15.0), ["N/m", ""], [16.5, 16.5]),
    ((2.0, 4.0e4), ["N/m", "kN/m"], [2.2, 44.0]),
])  # fmt: skip
def test_stiffnesses_of_several_runs_stand_in_their_own_unit(stiffnesses, labels, tops, figures):
    beam, runs = stops(*stiffnesses)
    time_history(runs, beam.at(1.0), "unused.png")
    lower = figures[0].axes[len(stiffnesses) :]
    assert [axes.get_ylabel().partition("[")[2].removesuffix("]") for axes in lower] == labels
    assert [axes.get_ylim()[1] for axes in lower] == pytest.approx(tops)
    for axes, top in zip(lower, tops, strict=True):
        drawn = max(float(np.max(line.get_ydata())) for line in axes.get_lines())
        assert drawn <= top
        assert drawn > 0.1 * top


def test_the_contact_of_a_foundation_at_the_point_is_shown(figures):
    beam = vf.Beam(1.0, 1.0, 1.0, 4, name="beam")
    scene = vf.Scene([beam], [vf.Foundation(beam, stiffness=50.0, one_sided=True, name="bed"), vf.Gravity(0.1)])
    result = vf.simulate(scene, 0.5)
    for arguments in ({}, {"contact": "bed[3]"}):
        time_history(result, beam.at(0.5), "unused.png", **arguments)
    names = [figure.axes[1].get_legend_handles_labels()[1] for figure in figures]
    assert names == [["bed[2]"], ["bed[3]"]]


@pytest.mark.parametrize("count", [5, 9])
def test_every_time_is_named_in_a_colour_of_its_own(count, paper, figures):
    shapes(paper[1], np.linspace(0.0, 4.0, count), "unused.png")
    (axes,) = figures[0].axes
    named = [text.get_text() for text in axes.get_legend().get_texts()]
    assert [name for name in named if name.startswith("t = ")] == [f"t = {t:g} s" for t in np.linspace(0, 4, count)]
    assert not any("more" in name for name in named)
    colours = [line.get_color() for line in axes.get_lines() if line.get_label().startswith("t = ")]
    assert len(set(colours)) == count


def test_shapes(paper, tmp_path):
    _, result = paper
    times = [1.0, 0.5 * (result.contacts["stop"].closings[0] + result.contacts["stop"].openings[0])]
    assert orange(pixels(shapes(result, times[:1], tmp_path / "open.png"))) == 0
    closed = pixels(shapes(result, times, tmp_path / "closed.png"))
    assert orange(closed) > 20
    x = np.linspace(0.0, 1.0, 30)
    beside = ("elsewhere", x, result.deflection(x, times))
    marked = pixels(shapes({"a": result, "b": result}, times, tmp_path / "marked.png", beside={"b": beside}))
    assert marked.shape[1] > closed.shape[1]
    with pytest.raises(vf.ArgumentError, match=r"shape \(30, 2\), expected \(30, 1\)"):
        shapes(result, times[:1], tmp_path / "a.png", beside=beside)
    for other, message in (
        (result, r"beside is Result\(.*expected a name, x in m and eta in m"),
        (("name", x), "expected a name, x in m and eta in m"),
        (("name", ["a"], [1.0]), "beside: x is .*expected an array of numbers"),
        (("name", x, np.full_like(x, np.nan)), "beside: eta holds nan"),
        ({"other": beside}, "beside: no outcome is named 'other'"),
    ):
        with pytest.raises(vf.ArgumentError, match=message):
            shapes({"a": result}, times, tmp_path / "a.png", beside=other)
    with pytest.raises(vf.ArgumentError, match="a time of the run, 0 to 6 s"):
        shapes(result, [7.0], tmp_path / "a.png")


def test_shapes_of_an_equilibrium_on_a_foundation(tmp_path):
    beam = vf.Beam(12.0, 1.0, 1.0, 40)
    bed = vf.Foundation(beam, stiffness=4.0, one_sided=True, name="bed")
    scene = vf.Scene([beam], [bed, vf.PointLoad(beam.at(6.0), -1.0)])
    outcome = vf.equilibrium(scene)
    places = along_beam(scene, beam)
    assert [p.x for p in places] == pytest.approx(beam.nodes)
    assert {p.surface for p in places} == {0.0}
    assert orange(pixels(shapes(outcome, None, tmp_path / "a.png", scene=scene))) > 100
    with pytest.raises(vf.ArgumentError, match="scene="):
        shapes(outcome, None, tmp_path / "b.png")
    free = vf.simulate(vf.Scene([beam], [vf.PointLoad(beam.at(6.0), -1.0)]), 1.0)
    assert orange(pixels(shapes(free, [0.0, 1.0], tmp_path / "c.png"))) == 0


def test_space_time(paper, tmp_path):
    _, result = paper
    assert pixels(space_time(result, tmp_path / "beam.png")).std() > 0.05
    chain = two_masses()
    assert [p.x for p in between_masses(chain)] == [1.5]
    assert pixels(space_time(vf.simulate(chain, 3.0), tmp_path / "masses.png")).std() > 0.05
    still = vf.simulate(vf.Scene(two_masses().bodies, []), 1.0, method="central_difference")
    assert space_time(still, tmp_path / "still.png").exists()


def test_which_beam_is_drawn(tmp_path):
    scene = two_beams()
    result = vf.simulate(scene, 0.1)
    for draw in (space_time, lambda r, path, **body: shapes(r, [0.1], path, **body)):
        with pytest.raises(vf.ArgumentError, match="say which one with body="):
            draw(result, tmp_path / "a.png")
        assert draw(result, tmp_path / "a.png", body="upper").exists()
    mass = vf.Mass(1.0)
    mixed = vf.simulate(vf.Scene([*scene.bodies[:1], mass], []), 0.1)
    with pytest.raises(vf.ArgumentError, match="beams and masses; say which beam"):
        space_time(mixed, tmp_path / "b.png")
    with pytest.raises(vf.ArgumentError, match="the scene has no beam, expected one"):
        shapes(vf.simulate(vf.Scene([mass]), 0.1), [0.1], tmp_path / "b.png")


def test_stepping_method(tmp_path):
    scene = two_sided(-30.0)
    (beam,) = scene.bodies
    result = vf.simulate(scene, 0.5, method="central_difference")
    assert time_history(result, beam.at(0.5), tmp_path / "a.svg").stat().st_size > 1000
    assert orange(pixels(render(result, 0.2, tmp_path / "a.png"))) > 200
    sparse = vf.simulate(scene, 0.5, method="central_difference", times=[0.0, 0.1, 0.2, 0.5])
    assert orange(pixels(render(sparse, 0.2, tmp_path / "b.png"))) > 200
    with pytest.raises(vf.ArgumentError, match="between the stored times"):
        render(sparse, 0.3, tmp_path / "c.png")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.png", "a.svg", "b.png"]


def test_wrong_arguments(paper, tmp_path):
    _, result = paper
    with pytest.raises(vf.ArgumentError, match="ends in"):
        render(result, 1.0, tmp_path / "a.jpg")
    with pytest.raises(vf.ArgumentError, match="0 to 6 s"):
        render(result, 7.0, tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match="NaN"):
        render(result, float("nan"), tmp_path / "a.png")
    with pytest.raises(vf.ArgumentError, match="scene="):
        render(vf.equilibrium(result.scene), None, tmp_path / "a.png")
    for size in WRONG_SIZES:
        with pytest.raises(vf.ArgumentError, match="a picture's size is"):
            render(result, 1.0, tmp_path / "a.png", size=size)


def test_numbers_read_well():
    assert [spell(v, "N") for v in (1330.0, 2.4e-11, 0.0347, 0.241, 0.0, 1e9)] == [
        "1.33 kN",
        "24.0 pN",
        "34.7 mN",
        "0.241 N",
        "0 N",
        "1.00 GN",
    ]
    assert (nice_below(4.9), nice_below(0.2), nice_above(0.141)) == pytest.approx((2.0, 0.2, 0.16))
