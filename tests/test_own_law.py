"""A law written outside the package: one class for the law, one for its effect, one entry for scene files."""

import math
from dataclasses import KW_ONLY, dataclass
from typing import Annotated, ClassVar

import numpy as np
import pytest
from scenes import cantilever
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import vofem as vf
from vofem.effects.kinds import AtPoint
from vofem.io.scene_file import load_scene
from vofem.io.scenes.schema import EFFECTS
from vofem.kernels.jit import jit
from vofem.laws import Law, Smooth
from vofem.laws.group import ListedLaws
from vofem.laws.law import COMMIT, FORCE, LOSS, MEAN, STORED, TANGENT, affine
from vofem.parameters import Name, Real, declared

STIFFNESS, LENGTH = 40.0, 0.1


def sinh_of(stiffness, length):
    """R = K L sinh(u/L): a spring that stiffens."""
    return Smooth(
        # cosh(x) - 1 without cancellation.
        potential=lambda u: 2.0 * stiffness * length**2 * math.sinh(0.5 * u / length) ** 2,
        force=lambda u: stiffness * length * math.sinh(u / length),
        slope=lambda u: stiffness * math.cosh(u / length),
    )


SINH = sinh_of(STIFFNESS, LENGTH)


@declared()
class SinhSpring:
    """The effect: a spring from a point to ground."""

    point: Annotated[vf.bodies.Point, AtPoint()]
    _: KW_ONLY
    stiffness: Annotated[float, Real("N/m", "Stiffness at u = 0.", above=0.0)]
    length: Annotated[float, Real("m", "Elongation over which the spring stiffens.", above=0.0)]
    name: Annotated[str, Name()] = "sinh"

    def points(self):
        return (self.point,)

    def compile(self, builder):
        law = Law(f"SinhSpring {self.name!r}", self.name, sinh_of(self.stiffness, self.length))
        builder.add_law(builder.row(self.point), law)

    def describe(self):
        return f"SinhSpring {self.name!r} at {self.point.describe()}"


def scene_of(mass, *more):
    return vf.Scene([mass], [SinhSpring(mass, stiffness=STIFFNESS, length=LENGTH), *more], initial={mass: (0.25, 0.0)})


def exact(times, damping=0.0):
    def rate(t, y):
        return [y[1], -SINH.reaction(y[0]) - damping * y[1]]

    return solve_ivp(rate, (0.0, times[-1]), [0.25, 0.0], t_eval=times, rtol=1e-11, atol=1e-12, method="DOP853").y


@pytest.mark.parametrize("method", ["energy_conserving", "generalized_alpha", "central_difference"])
def test_every_stepping_method_takes_it(method):
    mass, times = vf.Mass(1.0, name="m"), np.linspace(0.0, 1.0, 21)
    errors = []
    for dt in (2e-3, 1e-3):
        result = vf.simulate(scene_of(mass), 1.0, method=method, dt=dt, times=times)
        errors.append(np.max(np.abs(result.displacement(mass) - exact(times)[0])))
    assert errors[1] < 2e-4
    assert 1.8 < np.log2(errors[0] / errors[1]) < 2.2
    energy = result.energy
    expected = np.array([SINH.energy(u) for u in result.displacement(mass)])
    assert energy.strain == pytest.approx(expected, rel=1e-12)
    assert energy.balance_error < (1e-12 if method == "energy_conserving" else 1e-3)
    assert result.counters.law_evaluations > 0


@pytest.mark.parametrize("omega", [4.0, 7.5])
def test_harmonic_balance_takes_it(omega):
    """From the state that the orbit has at t = 0, a solver of differential equations returns there after a period."""
    damping, amplitude = 0.6, 6.0
    mass = vf.Mass(1.0, damping=damping, name="m")
    spring = SinhSpring(mass, stiffness=STIFFNESS, length=LENGTH)
    scene = vf.Scene([mass], [spring, vf.PointLoad(mass, vf.Sine(amplitude, omega))])
    orbit = vf.periodic(scene)
    assert orbit.method == "harmonic_balance"
    assert orbit.amplitude(mass) > 1.5 * LENGTH
    times = orbit.result.times

    def rate(t, y):
        return [y[1], amplitude * math.sin(omega * t) - SINH.reaction(y[0]) - damping * y[1]]

    start = [orbit.result.displacement(mass)[0], orbit.result.velocity(mass)[0]]
    u, v = solve_ivp(rate, (0.0, times[-1]), start, t_eval=times, rtol=1e-12, atol=1e-13, method="DOP853").y
    assert np.max(np.abs(orbit.result.displacement(mass) - u)) < 1e-9
    assert np.max(np.abs(orbit.result.velocity(mass) - v)) < 1e-8
    assert orbit.result.energy.strain == pytest.approx([SINH.energy(x) for x in u], abs=1e-8)
    assert orbit.result.energy.balance_error < 1e-9


def test_a_run_with_it_is_saved_and_loaded(tmp_path):
    mass = vf.Mass(1.0, name="m")
    scene = scene_of(mass)
    result = vf.simulate(scene, 0.5, method="energy_conserving", dt=1e-2)
    result.save(tmp_path / "run.h5")
    with pytest.raises(vf.MissingCallableError, match=r"SinhSpring 'sinh' at .*of a class of another package.*scene="):
        vf.load(tmp_path / "run.h5")
    with pytest.raises(vf.ArgumentError, match="the scene is another one than that of the file"):
        vf.load(tmp_path / "run.h5", scene=vf.Scene([mass], [vf.Spring(mass, stiffness=1.0)]))
    again = vf.load(tmp_path / "run.h5", scene=scene)
    loaded = again.scene.bodies[0]
    assert np.array_equal(again.displacement(loaded), result.displacement(mass))
    assert np.array_equal(again.energy.strain, result.energy.strain)


@dataclass(frozen=True)
class StructuralDamper:
    """R = K (1 + i loss) u of harmonic motions: a spring and the damping of a material, whatever the frequency."""

    name: str
    stiffness: float
    loss: float

    @property
    def label(self):
        return f"StructuralDamper {self.name!r}"

    @property
    def group(self):
        return StructuralDampers


class StructuralDampers(ListedLaws):
    """A group of its own, which exists in harmonic motions only."""

    kind: ClassVar[str] = "structural dampers"
    linear: ClassVar[bool] = True

    def nonlinearity(self, method):
        return f"{self.labels[0]} exists in harmonic motions only"

    def harmonic_stiffness(self, omega):
        return np.array([law.stiffness * (1.0 + 1.0j * law.loss) for law in self.laws])

    def stored_by_pairs(self, p):
        return np.array([np.full((p.size, p.size), law.stiffness) for law in self.laws])


def test_a_group_of_its_own_acts_in_harmonic_motions():
    """The response to F is F/(K (1 + i loss) - m omega^2)."""
    mass, k, loss = vf.Mass(2.0, name="m"), 50.0, 0.3

    class Effect(SinhSpring):
        def compile(self, builder):
            builder.add_law(builder.row(self.point), StructuralDamper("d", k, loss))

    damper = Effect(mass, stiffness=1.0, length=1.0)
    for frequency in (0.3, 0.8, 2.0):
        omega = 2.0 * np.pi * frequency
        scene = vf.Scene([mass], [damper, vf.PointLoad(mass, vf.Sine(4.0, omega))])
        expected = 1.0 / (k * (1.0 + 1.0j * loss) - 2.0 * omega**2)
        assert vf.frequency_response(scene, [frequency]).displacement(mass)[0] == pytest.approx(expected, rel=1e-12)
        orbit = vf.periodic(scene, method="harmonic_balance")
        phase = omega * orbit.result.times
        assert orbit.result.displacement(mass) == pytest.approx(
            4.0 * (expected * np.exp(1.0j * phase)).imag, abs=1e-12 * abs(expected)
        )
        energy = orbit.result.energy
        assert energy.strain == pytest.approx(0.5 * k * orbit.result.displacement(mass) ** 2, rel=1e-9, abs=1e-12)
        assert energy.dissipated[-1] == pytest.approx(np.pi * k * loss * abs(4.0 * expected) ** 2, rel=1e-9)
        assert energy.balance_error < 1e-9


@dataclass(frozen=True)
class Tightened:
    """R = preload + K (u - place): a spring under tension."""

    name: str
    stiffness: float
    preload: float
    place: float

    @property
    def label(self):
        return f"Tightened {self.name!r}"

    @property
    def group(self):
        return TightenedSprings


class TightenedSprings(ListedLaws):
    """A group whose laws are the affine function of the package, with numbers of their own."""

    kind: ClassVar[str] = "tightened springs"

    def nonlinearity(self, method):
        return None

    @property
    def forms(self):
        return tuple(
            Law(law.label, law.name, affine, np.array([law.preload, law.stiffness, law.place, 0.0]), np.zeros(0), 40.0)
            for law in self.laws
        )


class TightenedSpring(SinhSpring):
    def __init__(self, point, stiffness, preload, place, name="tight"):
        super().__init__(point, stiffness=stiffness, length=1.0, name=name)
        self.law = Tightened(name, stiffness, preload, place)

    def compile(self, builder):
        builder.add_law(builder.row(self.point), self.law)


STEPPING = ["energy_conserving", "generalized_alpha", "central_difference"]


@pytest.mark.parametrize("options", [*({"method": name, "dt": 1e-2} for name in STEPPING), {"tol": 1e-3}])
def test_an_affine_law_beside_others_is_a_spring_and_a_constant_load(options):
    mass, times = vf.Mass(1.0, name="m"), np.linspace(0.0, 2.0, 21)
    others = [
        vf.Contact(mass, gap=0.1, stiffness=300.0, side="above", acts_on="penetration", name="stop"),
        vf.Springpot(mass, coefficient=0.5, order=0.5, name="pot"),
        vf.PointLoad(mass, vf.Sine(6.0, 5.0)),
    ]
    start = {"initial": {mass: (0.0, 0.3)}}
    law = vf.Scene([mass], [TightenedSpring(mass, 40.0, 3.0, 0.02), *others], **start)
    loads = [vf.Spring(mass, stiffness=40.0), vf.PointLoad(mass, 40.0 * 0.02 - 3.0)]
    plain = vf.Scene([mass], [*loads, *others], **start)
    ours, expected = (vf.simulate(scene, 2.0, times=times, **options) for scene in (law, plain))
    assert expected.contacts["stop"].closings.size > 1
    tolerance = 1e-9 if "dt" in options else 10.0 * options["tol"]
    size = np.max(np.abs(expected.displacement(mass)))
    assert ours.displacement(mass) == pytest.approx(expected.displacement(mass), rel=0.0, abs=tolerance * size)


def test_an_affine_law_of_a_group_of_its_own_is_not_left_out_by_event_driven():
    mass = vf.Mass(1.0, name="m")
    scene = vf.Scene([mass], [TightenedSpring(mass, 40.0, 3.0, 0.02)])
    with pytest.raises(vf.MethodError, match="Tightened 'tight' is no contact, and event_driven takes no other laws"):
        vf.simulate(scene, 1.0, method="event_driven")
    assert vf.simulate(scene, 1.0).method != "event_driven"
    assert vf.equilibrium(scene).displacement(mass) == pytest.approx(0.02 - 3.0 / 40.0, rel=1e-12)


@pytest.mark.parametrize("load", [0.5, 40.0, -30.0])
def test_statics_takes_a_law_whose_force_never_falls(load):
    mass = vf.Mass(1.0, stiffness=3.0, name="m")
    stop = vf.Contact(mass, gap=0.2, stiffness=100.0, side="above", acts_on="penetration", name="stop")
    scene = vf.Scene([mass], [SinhSpring(mass, stiffness=STIFFNESS, length=LENGTH), stop, vf.PointLoad(mass, load)])

    def residual(u):
        return SINH.reaction(u) + 3.0 * u + 100.0 * max(u - 0.2, 0.0) - load

    expected = brentq(residual, -5.0, 5.0, xtol=1e-16, rtol=1e-15)
    outcome = vf.equilibrium(scene)
    assert outcome.displacement(mass) == pytest.approx(expected, rel=1e-12)
    assert outcome.contacts["stop"].closed == (expected > 0.2)
    path = vf.quasi_static(scene, [0.5, 1.0])
    assert path.displacement(mass)[-1] == pytest.approx(expected, rel=1e-12)


def test_a_law_whose_force_may_fall_is_refused_by_name():
    mass = vf.Mass(1.0)
    law = Law("SinhSpring 'odd'", "odd", sinh_of(1.0, 1.0), rising=False)

    class Odd(SinhSpring):
        def compile(self, builder):
            builder.add_law(builder.row(self.point), law)

    scene = vf.Scene([mass], [Odd(mass, stiffness=1.0, length=1.0), vf.PointLoad(mass, 1.0)])
    with pytest.raises(vf.ArgumentError, match="SinhSpring 'odd' may have several equilibria"):
        vf.equilibrium(scene)
    with pytest.raises(vf.MethodError, match="SinhSpring 'odd' is not piecewise linear"):
        vf.simulate(scene, 1.0, method="event_driven")
    with pytest.raises(vf.ArgumentError, match="SinhSpring 'odd' has no modes"):
        vf.modes(scene)


def test_a_reaction_counts_it():
    """What the clamp of a beam holds is what inertia and the spring leave over."""
    beam = cantilever(4, name="b")
    tip = beam.at(1.0)
    scene = vf.Scene(
        [beam], [SinhSpring(tip, stiffness=STIFFNESS, length=LENGTH), vf.PointLoad(tip, 2.0), vf.RayleighDamping(3.0)]
    )
    result = vf.simulate(scene, 30.0, method="generalized_alpha", dt=0.01, times=[30.0])
    rest = vf.equilibrium(scene)
    assert result.displacement(tip)[-1] == pytest.approx(rest.displacement(tip), rel=1e-9)
    held = SINH.reaction(rest.displacement(tip)) - 2.0
    assert result.reaction(beam, "left").force[-1] == pytest.approx(held, rel=1e-6)


@jit
def _slider(what, parameters, past, u0, u1):
    """A spring beside a slider on a spring, as `vf.BilinearSpring`; its internal variable is the slider's place."""
    beside, spring, slip = parameters[0], parameters[1], parameters[2]
    limit, stretch = slip / spring, u1 - past[0]
    if what == FORCE or (what == MEAN and u0 == u1):
        return beside * u1 + min(max(spring * stretch, -slip), slip)
    if what == TANGENT:
        return beside + spring if abs(stretch) < limit else beside
    if what == STORED:
        return 0.5 * beside * u1 * u1 + 0.5 * spring * min(abs(stretch), limit) ** 2
    if what == LOSS:
        return slip * max(abs(stretch) - limit, 0.0)
    if what == MEAN:
        first, last = abs(u0 - past[0]), abs(stretch)
        begin = 0.5 * spring * first**2 if first < limit else slip * (first - 0.5 * limit)
        end = 0.5 * spring * last**2 if last < limit else slip * (last - 0.5 * limit)
        return 0.5 * beside * (u0 + u1) + (end - begin) / (u1 - u0)
    if what == COMMIT:
        past[0] = min(max(past[0], u1 - limit), u1 + limit)
    return 0.0


class SliderSpring(SinhSpring):
    """An effect whose law has an internal variable."""

    def compile(self, builder):
        law = Law("SliderSpring 's'", "s", _slider, np.array([0.2, 0.8, 0.08]), np.zeros(1), stiffness=1.0)
        builder.add_law(builder.row(self.point), law)


def both_sliders():
    """Return a mass and its scene, with the law from outside the package and with that of the package."""
    for make in (
        lambda mass: SliderSpring(mass, stiffness=1.0, length=1.0, name="s"),
        lambda mass: vf.BilinearSpring(mass, stiffness=1.0, linear_limit=0.1, hardening=0.2, name="s"),
    ):
        mass = vf.Mass(1.0, name="m")
        yield mass, vf.Scene([mass], [make(mass), vf.PointLoad(mass, vf.Sine(0.3, 1.3))])


@pytest.mark.parametrize(
    "how",
    [
        {"method": "energy_conserving", "dt": 0.01},
        {"method": "generalized_alpha", "dt": 0.01},
        {"method": "central_difference", "dt": 0.01},
        {"tol": 1e-3},
    ],
    ids=lambda how: how.get("method", "tol"),
)
def test_a_compiled_law_with_internal_variables_is_written_outside_the_package(how):
    """It moves a mass as the same law of the package does."""
    (own_mass, own), (mass, scene) = both_sliders()
    times, near = np.linspace(0.0, 20.0, 101), 1e-4 if "tol" in how else 1e-8
    mine, theirs = vf.simulate(own, 20.0, times=times, **how), vf.simulate(scene, 20.0, times=times, **how)
    assert theirs.energy.dissipated[-1] > 0.1
    # The mean force of a short path has a rounding error, by which a tolerance chooses other steps.
    assert mine.displacement(own_mass) == pytest.approx(theirs.displacement(mass), abs=near)
    for part in ("strain", "dissipated"):
        assert getattr(mine.energy, part) == pytest.approx(getattr(theirs.energy, part), abs=near)
    assert mine.notes == theirs.notes


def test_statics_takes_it_harmonic_balance_does_not_and_runs_with_it_are_saved(tmp_path):
    (own_mass, own), (mass, scene) = both_sliders()
    factors = [0.3, -0.4, 0.2]
    pushed = [
        vf.quasi_static(vf.Scene([body], [spring.effects[0], vf.PointLoad(body, 1.0)]), factors).displacement(body)
        for body, spring in ((own_mass, own), (mass, scene))
    ]
    assert pushed[0] == pytest.approx(pushed[1], rel=1e-12)
    with pytest.raises(vf.MethodError, match="SliderSpring 's' does not say how its force depends on its internal"):
        vf.periodic(own)
    result = vf.simulate(own, 5.0, method="energy_conserving", dt=0.01)
    result.save(tmp_path / "run.h5")
    with pytest.raises(vf.MissingCallableError, match=r"Spring 's' at .*of a class of another package.*scene="):
        vf.load(tmp_path / "run.h5")
    again = vf.load(tmp_path / "run.h5", scene=own)
    assert np.array_equal(again.displacement(again.scene.bodies[0]), result.displacement(own_mass))
    assert np.array_equal(again.energy.dissipated, result.energy.dissipated)


def test_an_entry_makes_it_part_of_scene_files(tmp_path, monkeypatch):
    monkeypatch.setitem(EFFECTS, "sinh_spring", SinhSpring)
    file = tmp_path / "scene.toml"
    file.write_text(
        '[[mass]]\nname = "m"\nmass = 1.0\n[[sinh_spring]]\npoint = "m"\nstiffness = 40.0\nlength = 0.1\n'
        '[[point_load]]\npoint = "m"\nf = 1.0\n[run]\nt_end = 1.0\n'
    )
    scene = load_scene(file).scene
    u = vf.equilibrium(scene).displacement(scene.bodies[0])
    assert SINH.reaction(u) == pytest.approx(1.0, rel=1e-12)
