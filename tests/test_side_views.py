"""Side views show loads, gaps, dashpots, crushing stops, point masses, and a strip of moments."""

import numpy as np
import pytest

import vofem as vf
from vofem.io.pictures.drawing import BLOCK, CLOSED, INK
from vofem.io.pictures.links import LOAD
from vofem.io.pictures.sketch import sketch
from vofem.io.pictures.snapshot import at_rest, snapshot

SIZE = (1600, 700)

pytestmark = pytest.mark.kernels("plain")


def scene_of(*effects, **options):
    beam = vf.Beam(length=1.0, EI=1.0, rhoA=1.0, elements=4, supports={"left": "clamped"}, name="beam", **options)
    return beam, vf.Scene([beam], [make(beam) for make in effects])


def drawn(effects, t=0.5, t_end=1.0, **options):
    beam, scene = scene_of(*effects)
    return beam, sketch(snapshot(vf.simulate(scene, t_end, **options), t), SIZE, None)


def words(drawing):
    return [label.text for label in drawing.labels]


def arrows(drawing):
    """Heads of load arrows: tips, and whether they point up."""
    return [
        (part.points[0], part.points[0, 1] > part.points[1:, 1].mean())
        for part in drawing.patches
        if part.color == LOAD and len(part.points) == 3
    ]


def test_loads_are_arrows_in_their_direction():
    beam, drawing = drawn([lambda b: vf.PointLoad(b.at(1.0), -0.2)])
    ((tip, up),) = arrows(drawing)
    assert not up
    assert "-0.200 N" in words(drawing)
    _, drawing = drawn([lambda b: vf.PointLoad(b.at(0.5), 0.3)])
    ((other, up),) = arrows(drawing)
    assert up
    assert other[0] < tip[0]
    assert beam.name == "beam"


def test_what_rounding_leaves_of_a_load_is_none():
    """At t = 2 pi the sine of this load is -2.4e-16."""
    _, drawing = drawn([lambda b: vf.PointLoad(b.at(0.5), vf.Sine(1.0, 1.0))], t=2.0 * np.pi, t_end=7.0)
    assert not arrows(drawing)
    (label,) = (label for label in drawing.labels if label.text == "0 N")
    # The outline of the beam does not strike it out.
    for line in (line.points for line in drawing.lines if line.color == INK):
        behind = line[(line[:, 0] > label.x) & (line[:, 0] < label.x + label.size)]
        assert np.all(np.abs(behind[:, 1] - label.y) > 0.4 * label.size)


def test_gravity_has_its_label_beside_a_long_title():
    masses = [vf.Mass(1.0, 100.0, name=f"a mass with quite a long name, number {k}") for k in range(3)]
    result = vf.simulate(vf.Scene(masses, [vf.Gravity(0.5)]), 1.0)
    assert "g = 0.5 m/s²" in words(sketch(snapshot(result, 0.5), SIZE, None))


def test_an_arrow_is_as_long_as_the_load_is_large():
    sizes = []
    for t in (np.pi / 6.0, np.pi / 2.0):
        _, drawing = drawn([lambda b: vf.PointLoad(b.at(1.0), vf.Sine(-1.0, 1.0))], t=t, t_end=3.0)
        line = next(part for part in drawing.lines if part.color == LOAD)
        head = arrows(drawing)[0][0]
        sizes.append(float(line.points[:, 1].max() - head[1]))
    assert sizes[0] == pytest.approx(0.5 * sizes[1], rel=1e-3)


def test_moments_loads_along_a_beam_and_the_weight():
    _, drawing = drawn([lambda b: vf.PointMoment(b.at(1.0), 0.1)])
    assert any(part.color == LOAD and len(part.points) > 20 for part in drawing.lines)
    _, drawing = drawn([lambda b: vf.DistributedLoad(b, -1.0)])
    assert len(arrows(drawing)) == 9
    _, drawing = drawn([lambda b: vf.Gravity(9.81)])
    assert [up for _, up in arrows(drawing)] == [False]
    assert "g = 9.81 m/s²" in words(drawing)


def test_an_open_stop_shows_the_size_of_its_gap():
    def stop(beam):
        return vf.Contact(beam.at(1.0), gap=0.02, stiffness=5.0, side="below", acts_on="penetration", name="s")

    _, drawing = drawn([stop, lambda b: vf.PointLoad(b.at(1.0), 0.05)])
    assert "gap 20.0 mm" in words(drawing)
    _, drawing = drawn([stop, lambda b: vf.PointLoad(b.at(1.0), -0.5)], t=1.0)
    assert not any(text.startswith("gap") for text in words(drawing))


def test_dashpots_point_masses_and_the_strip_of_one_beam():
    _, bare = drawn([])
    _, drawing = drawn([lambda b: vf.Dashpot(b.at(1.0), damping=0.1), lambda b: vf.PointMass(b.at(0.5), mass=0.1)])
    assert len(drawing.lines) == len(bare.lines) + 4
    assert sum(dots.color == BLOCK for dots in drawing.dots) == 1
    assert "M" in words(bare)


def test_a_crushing_stop_is_open_or_closed():
    stop = lambda b: vf.CrushingStop(  # noqa: E731
        b.at(1.0), gap=0.01, side="below", stiffness=20.0, linear_limit=0.02, name="crush"
    )
    states = []
    for t in (0.0, 1.0):
        _, drawing = drawn(
            [stop, lambda b: vf.PointLoad(b.at(1.0), -0.5)], t=t, method="energy_conserving", dt=1e-2, compiled=False
        )
        states.append(any(patch.color == CLOSED for patch in drawing.patches))
    assert states == [False, True]


def test_a_scene_at_rest_has_no_motion_and_no_moments():
    _, scene = scene_of(lambda b: vf.Contact(b.at(1.0), gap=0.02, stiffness=5.0, side="below", acts_on="penetration"))
    drawing = sketch(at_rest(scene), SIZE, None)
    assert "at rest" in words(drawing)
    assert not any("bending" in text for text in words(drawing))
