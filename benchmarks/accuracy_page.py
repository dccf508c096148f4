"""Write docs/accuracy.md and its figures anew: ``python benchmarks/accuracy_page.py``; it takes some ten minutes.

Everything on the page is measured by this script in one run on one machine.
Peers that are not installed are left out by name; see `side_by_side`.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

# Before numpy: several threads of BLAS spoil timings of small matrices.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Timings are those of compiled code, however short a run is.
os.environ.setdefault("VOFEM_COMPILED", "1")

import effects
import kernels
import minimal
import numpy as np
import response_curves
import side_by_side
from cases import paper_beam, two_masses
from curves import Curve, Panel, log_curves

import vofem as vf
from vofem.integrators.critical_step import critical_step
from vofem.io.pictures.work_precision import work_precision as draw_study
from vofem.studies.accuracy.exact import Question, rounding
from vofem.studies.accuracy.quantities import observe
from vofem.studies.accuracy.study import Study
from vofem.studies.accuracy.timing import machine
from vofem.verification.cases.published import loosely_supported_tube

DOCS = Path(__file__).parent.parent / "docs"
FIGURES = DOCS / "figures"
#: Sections that are measured, until all are.
STORE = DOCS.parent / "build" / "accuracy"
T_END = 20.0
MESHES = (25, 100, 400, 1000)
STEPPING = ("energy_conserving", "generalized_alpha", "central_difference")


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')}  {text}", file=sys.stderr, flush=True)


# -- the paper's beam -------------------------------------------------------------------------------


def beam_studies() -> dict[str, Study]:
    """Return the studies of both force laws, 25 to 1 000 elements."""
    studies = {}
    for law in ("penetration", "displacement"):
        say(f"the paper's beam, {law} law")
        studies[law] = vf.accuracy.work_precision(
            paper_beam(law), T_END, methods=("event_driven", "energy_conserving", "generalized_alpha"),
            dt=[T_END / n for n in (200, 1000, 5000, 25_000, 100_000)], elements=MESHES, repeats=2, cap=1.5,
        )  # fmt: skip
        draw_study(studies[law], FIGURES / f"accuracy-beam-{law}.png", f"The paper's beam, {law} law, {T_END:g} s")
    return studies


def beam_section(studies: dict[str, Study]) -> str:
    parts = [
        "## The paper's beam",
        f"The cantilever of section 4.2 over {T_END:g} s. The error is the largest error of the tip's displacement "
        "over the largest displacement of the tip. Where points lie on a dashed line the error is that of the mesh, "
        "and smaller steps do not reduce it.",
    ]
    for law, study in studies.items():
        parts += [
            f"![Error of the tip against wall time and steps, {law} law](figures/accuracy-beam-{law}.png)",
            f"**{law.capitalize()} law.** {study.advice(1e-3)} {study.advice(1e-6)}",
            _beam_table(study),
        ]
    return "\n\n".join(parts)


def _beam_table(study: Study) -> str:
    scale = study.reference.scale
    lines = ["| elements | event_driven, time | error | of which rounding |", "| ---: | ---: | ---: | ---: |"]
    for run in study.runs:
        if run.setting.method == "event_driven":
            lines.append(
                f"| {run.setting.elements} | {1e3 * run.seconds:.3g} ms | {study.relative(run):.1e} "
                f"| {run.rounding / scale:.0e} |"
            )
    lines.append(f"\nReference: {study.reference.how}, known to {study.floor:.0e}.")
    return "\n".join(lines)


# -- orders -----------------------------------------------------------------------------------------


def order_section() -> str:
    say("observed orders")
    lines = [
        "| scene | law | " + " | ".join(STEPPING) + " |",
        "| --- | --- |" + " ---: |" * len(STEPPING),
    ]
    seen: dict[str, list[float]] = {"penetration": [], "displacement": []}
    for law in seen:
        cases = {
            "beam, 25 elements": (paper_beam(law)(25), 20.0),
            "two masses, case b": (two_masses("b", law), 40.0),
            "two masses, case c": (two_masses("c", law), 40.0),
        }
        for name, (scene, t_end) in cases.items():
            found = {method: _order(scene, t_end, method) for method in STEPPING}
            seen[law] += [order for order in found.values() if np.isfinite(order)]
            cells = [f"{found[method]:.2f}" for method in STEPPING]
            lines.append(f"| {name} | {law} | " + " | ".join(cells) + " |")
    smooth, jump = seen["penetration"], seen["displacement"]
    # The first method's: of the beam, and of the two cases of masses.
    kept = jump[len(STEPPING) :: len(STEPPING)]
    return "\n\n".join(
        [
            "## Where O(dt^2) holds and where it does not",
            f"The paper states an error of O(dt^2). With the **penetration law** the force is continuous and "
            f"the orders observed "
            f"here are {min(smooth):.2f} to {max(smooth):.2f}: the claim holds. With the **displacement law**, the one "
            f"in the paper's equations, the force jumps by K0 gap at every closing and opening, somewhere "
            f"inside a step, "
            f"and the orders scatter from {min(jump):.2f} to {max(jump):.2f}: the claim does not hold in general. "
            f"energy_conserving takes the mean force over a step; its orders on the two masses are {min(kept):.2f} and "
            f"{max(kept):.2f}. event_driven has no step; its switches are found to rounding under both laws.",
            "Orders are slopes of a straight line through the logarithms of rms errors over seven step sizes, each "
            "error against the run on the same mesh that is exact in time.",
            "\n".join(lines),
        ]
    )


def _order(scene: vf.Scene, t_end: float, method: str) -> float:
    """Return the slope of rms errors over steps, on one mesh."""
    point, times = scene.contacts[0].a, np.linspace(0.0, t_end, 401)
    truth = vf.simulate(scene, t_end, times=times).displacement(point)
    limit = 0.9 * critical_step(scene.model.system) if method == "central_difference" else np.inf
    first = min(limit, t_end / 2000)
    # Many uneven ratios: that a switch falls at the same place of the step each time would be chance.
    steps = first / np.geomspace(1.0, 6.0, 7)
    errors = []
    for dt in steps:
        run = vf.simulate(scene, t_end, method=method, dt=float(dt), times=times)
        errors.append(np.sqrt(np.mean(np.square(run.displacement(point) - truth))))
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


# -- the explicit limit -----------------------------------------------------------------------------


def explicit_section() -> str:
    say("the explicit limit")
    lines = [
        "| elements | critical step | steps in 20 s | time of 20 s | event_driven |",
        "| ---: | ---: | ---: | ---: | ---: |",
    ]
    shown = []
    for n in (25, 50, 100, 200):
        scene = paper_beam("penetration")(n)
        limit = critical_step(scene.model.system)
        dt, steps = 0.9 * limit, 20_000
        _run(scene, 10 * dt, dt)
        seconds = _seconds(_run, 3, scene, steps * dt, dt) / steps
        ours = _seconds(vf.simulate, 3, scene, T_END)
        total = T_END / dt
        shown.append(total * seconds / ours)
        lines.append(f"| {n} | {limit:.3g} s | {total:.2g} | {total * seconds:.2g} s | {1e3 * ours:.2g} ms |")
    return "\n\n".join(
        [
            "## What the explicit step limit costs",
            "Central differences (the paper's Eq. 21) are stable for dt < 2/omega_max only, and omega_max of a beam "
            "grows with the square of the number of elements: twice as many elements need four times as many steps, "
            "and each step takes twice as long. The paper's dt = 1e-3 s, given for its masses, lies far beyond the "
            "limit of its beam. With steps below this limit the error is caused by the mesh, not by the steps. The "
            "times were measured over 20 000 steps and scaled to the whole run; "
            f"event_driven is {min(shown):.0f} to {max(shown):.0f} times faster.",
            "\n".join(lines),
        ]
    )


def _run(scene: vf.Scene, t_end: float, dt: float) -> None:
    vf.simulate(scene, t_end, method="central_difference", dt=dt, times=[0.0])


def _seconds(work: Callable[..., object], repeats: int, *arguments: object) -> float:
    """Return the shortest of several times, s."""
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        work(*arguments)
        best = min(best, time.perf_counter() - start)
    return best


# -- rounding ---------------------------------------------------------------------------------------


def rounding_section() -> str:
    say("mesh errors and rounding")
    meshes = (8, 16, 32, 64, 128, 256, 512, 1024)
    t_end, times = 10.0, np.linspace(0.0, 10.0, 201)
    scenes = {n: paper_beam("penetration")(n) for n in (*meshes, 4096)}
    ways = {
        "rounding, event_driven in all modes": {"method": "event_driven", "truncation": 0},
        "rounding, event_driven in Ritz vectors": {"method": "event_driven", "truncation": 1e-11},
        "rounding, energy_conserving": {"method": "energy_conserving", "dt": 4e-3},
    }
    point = scenes[8].contacts[0].a
    question = Question(t_end, times, point, 1.0)
    fine = vf.simulate(scenes[4096], t_end, times=times, truncation=1e-11).displacement(point)
    scale = float(np.max(np.abs(fine)))
    found: dict[str, dict[int, float]] = {"error of the mesh": {}, **{name: {} for name in ways}}
    for n in meshes:
        for name, how in ways.items():
            if "all modes" in name and n > 512:
                continue

            def run(scene: vf.Scene, asked: Question, how: dict = how) -> vf.Result:
                return vf.simulate(scene, asked.t_end, times=asked.times, **how)

            result = run(scenes[n], question)
            observed = observe(result, point)
            found[name][n] = rounding(scenes[n], question, observed, t_end, run) / scale
            if "Ritz" in name:
                found["error of the mesh"][n] = float(np.max(np.abs(observed.history - fine))) / scale
    curves = [
        Curve(name, list(part), [max(v, 1e-16) for v in part.values()], strong=name == "error of the mesh")
        for name, part in found.items()
    ]
    log_curves(
        [Panel(curves, "elements", "error / largest displacement", "The paper's beam, penetration law, 10 s")],
        FIGURES / "accuracy-rounding.png",
    )
    mesh = found["error of the mesh"]
    sentences = []
    for name in list(ways):
        part = found[name]
        worse = [n for n in part if part[n] > mesh[n]]
        method = name.removeprefix("rounding, ")
        sentences.append(
            f"with {method} from {worse[0]} elements on"
            if worse
            else f"with {method} up to {max(part)} elements it still pays"
        )
    lines = ["| elements | " + " | ".join(found) + " |", "| ---: |" + " ---: |" * len(found)]
    for n in meshes:
        cells = [f"{part[n]:.0e}" if n in part else "-" for part in found.values()]
        lines.append(f"| {n} | " + " | ".join(cells) + " |")
    return "\n\n".join(
        [
            "## Where refining the mesh stops paying",
            "The error of the mesh falls like the fourth power of the element length, while rounding with nodal "
            "unknowns grows like the fourth power of the number of elements. Runs in modes or Ritz vectors take their "
            "digits from the strains and lose few. Rounding is measured by a second run of "
            "the same equations, all multiplied by 3, which have the same solution but other rounding errors. Refining "
            f"the mesh does not pay where rounding exceeds the error of the mesh: {'; '.join(sentences)}. "
            "Beyond that, more elements do not improve the result, or make it worse.",
            "![Error of the mesh and rounding over the number of elements](figures/accuracy-rounding.png)",
            "\n".join(lines),
        ]
    )


# -- stiff stops and chaos --------------------------------------------------------------------------


def chaos_section() -> str:
    say("stiff stops")
    lines = [
        "| law | K0 [N/m] | events in 20 s | growth of a perturbation | to 1e-3 until | time, event_driven "
        "| energy_conserving, dt = 1e-3 s: error until then | rms over 20 s |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
    ]
    until = {}
    vf.simulate(paper_beam("displacement", 1e4)(25), 5.0)
    for law in ("penetration", "displacement"):
        for stiffness in (1.0, 1e2, 1e4, 1e6):
            scene = paper_beam(law, stiffness)(25)
            point, times = scene.contacts[0].a, np.linspace(0.0, T_END, 2001)
            start = time.perf_counter()
            exact = vf.simulate(scene, T_END, times=times)
            seconds = time.perf_counter() - start
            horizon = exact.sensitivity.horizon()
            until[law, stiffness] = horizon
            truth, before = exact.displacement(point), times <= horizon
            try:
                stepped = vf.simulate(scene, T_END, method="energy_conserving", dt=1e-3, times=times).displacement(
                    point
                )
                error = np.max(np.abs(stepped - truth)[before]) / np.max(np.abs(truth[before]))
                level = np.sqrt(np.mean(stepped**2) / np.mean(truth**2)) - 1.0
                outcome = f"{error:.0e} | {100 * level:+.1f} %"
            except vf.VofemError as fault:
                outcome = f"{type(fault).__name__} | -"
            lines.append(
                f"| {law} | {stiffness:g} | {exact.counters.events} | 10^{exact.sensitivity.growth[-1]:.1f} "
                f"| {horizon:.3g} s | {1e3 * seconds:.3g} ms | {outcome} |"
            )
    return "\n\n".join(
        [
            "## Stiff stops: when a scene is chaotic",
            "`result.sensitivity` follows a perturbation along an event-driven run. Against stiff stops a "
            "perturbation grows by many powers of ten, and so does rounding. From the time "
            "`result.sensitivity.horizon()` on, pointwise values mean nothing, whatever the method and the step: "
            f"for K0 = 1e6 from t = {until['penetration', 1e6]:.3g} s "
            f"(penetration law) and {until['displacement', 1e6]:.3g} s (displacement law). `horizon(tolerance)` "
            "gives the earlier time until which a smaller error can be kept. Errors of steps and meshes are "
            "perturbations too. They are larger than rounding, so a stepping method loses the true history much "
            "earlier. Means, rms values and impulses keep a meaning. Studies of such scenes (`vofem accuracy`) compare "
            "pointwise values up to the horizon only, and report the rms over the whole run as well.",
            "\n".join(lines),
        ]
    )


# -- steps that follow a tolerance ------------------------------------------------------------------


def between_stops(stiffness: float) -> tuple[vf.Scene, vf.Mass, float]:
    """Return a free mass that flies to and fro between two stops, and the end of its run in s."""
    mass = vf.Mass(1.0, name="mass")
    stops = [
        vf.Contact(mass, gap=0.5, stiffness=stiffness, side=side, acts_on="penetration", name=side)
        for side in ("above", "below")
    ]
    return vf.Scene([mass], stops, {mass: (0.0, 1.0)}), mass, 9.7


def mass_on_beam(stiffness: float) -> tuple[vf.Scene, vf.Mass, float]:
    """Return a mass that hits a beam of four elements, and the end of its run in s."""
    beam = vf.Beam(1.0, 1.0, 1.0, 4, {"left": "pinned", "right": "pinned"}, name="beam")
    mass = vf.Mass(0.3, name="mass")
    stop = vf.Contact(mass, beam.at(0.5), gap=0.1, stiffness=stiffness, acts_on="penetration", name="stop")
    return vf.Scene([beam, mass], [stop], {mass: (0.0, 1.0)}), mass, 2.0


def tolerance_section() -> str:
    say("steps that follow a tolerance")
    scene, _, _ = between_stops(1e2)
    vf.simulate(scene, 0.1, method="energy_conserving", tol=1e-2)  # loads the compiled loops
    lines = [
        "| scene | K0 [N/m] | tol | error over tol | steps | of them refused | time | event_driven | a note says so |",
        "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
    ]
    seen: dict[str, list[float]] = {}
    impacts: dict[str, set[int]] = {}
    times_over: list[float] = []
    told: dict[str, list[bool]] = {}
    scenes = {"mass between two stops": between_stops, "mass on a beam": mass_on_beam}
    for name, make in scenes.items():
        for stiffness in (1e2, 1e4, 1e6, 1e8):
            scene, mass, t_end = make(stiffness)
            times = np.linspace(0.0, t_end, 401)
            exact = vf.simulate(scene, t_end, times=times)
            truth = exact.displacement(mass)
            impacts.setdefault(name, set()).add(sum(c.closings.size for c in exact.contacts.values()))
            least = _seconds(vf.simulate, 5, scene, t_end)
            for tol in (1e-2, 1e-3, 1e-4):
                begin = time.perf_counter()
                run = vf.simulate(scene, t_end, method="energy_conserving", tol=tol, times=times)
                taken = time.perf_counter() - begin
                times_over.append(taken / least)
                error = float(np.max(np.abs(run.displacement(mass) - truth)) / np.max(np.abs(truth))) / tol
                note = any(text.startswith("tol: displacements may") for text in run.notes)
                seen.setdefault(name, []).append(error)
                told.setdefault(name, []).append(note)
                lines.append(
                    f"| {name} | {stiffness:g} | {tol:g} | {error:.2g} | {run.counters.steps} "
                    f"| {run.counters.rejected} | {1e3 * taken:.3g} ms | {1e3 * least:.3g} ms "
                    f"| {'yes' if note else 'no'} |"
                )
    free, beam = (seen[name] for name in scenes)
    hits = sorted(impacts["mass on a beam"])
    often = f"{hits[0]} times" if len(hits) == 1 else f"{hits[0]} to {hits[-1]} times"
    silent = [error for error, note in zip(beam, told["mass on a beam"], strict=True) if not note]
    return "\n\n".join(
        [
            "## What tol= costs and keeps against stiff stops",
            "`energy_conserving` with `tol=` bounds displacements, not velocities or contact forces. The displacement "
            "errors of the single steps are estimated by halving each step; their sum over the largest displacement "
            "stays below the tolerance. How these errors grow through later impacts is not bounded.",
            f"**Masses** stay within the tolerance: between two stops errors are at most {max(free):.2g} tol, whatever "
            "the stiffness. **Beams** do not always stay within it. An impact excites their fast modes, whose "
            "displacements are tiny but whose velocities change the next impact. In the runs below a mass hits a beam "
            f"of four elements {often}, and errors are up to {max(beam):.2g} tol; "
            + (
                f"without a note they are at most {max(silent):.2g} tol. "
                if silent
                else "every one of these runs has a note that says so. "
            )
            + "The note appears if the run differs from one of four times the tolerance by more than five times the "
            "tolerance; it gives the difference. If the sum of the velocity errors were bounded too, the beam would "
            "stay within the tolerance, but the paper's beam would need 194 276 steps instead of 126.",
            f"Errors are against event_driven, which is exact. The runs take {min(times_over):.2g} to "
            f"{max(times_over):.2g} times as long as event_driven (best of five runs; the others: one run each).",
            "\n".join(lines),
        ]
    )


# -- finite s0 --------------------------------------------------------------------------------------


def resolved_section() -> str:
    say("resolved switches")
    lines = ["| law | " + " | ".join(f"s0 = {s0:g} 1/m" for s0 in _S0) + " | slope |", "| --- |" + " ---: |" * 5]
    slopes = {}
    for law in ("penetration", "displacement"):
        point, times = paper_beam(law)(25).contacts[0].a, np.linspace(0.0, 5.0, 201)
        ideal = vf.simulate(paper_beam(law)(25), 5.0, times=times).displacement(point)
        apart = []
        for s0 in _S0:
            scene = paper_beam(law, switch=vf.Resolved(s0))(25)
            run = vf.simulate(scene, 5.0, method="energy_conserving", dt=5e-5, times=times)
            apart.append(float(np.max(np.abs(run.displacement(point) - ideal)) / np.max(np.abs(ideal))))
        slopes[law] = float(-np.polyfit(np.log(_S0[:3]), np.log(apart[:3]), 1)[0])
        lines.append(f"| {law} | " + " | ".join(f"{x:.0e}" for x in apart) + f" | {slopes[law]:.1f} |")
    study = vf.accuracy.work_precision(
        paper_beam("penetration", switch=vf.Resolved(1e4)), 5.0, elements=(25,), repeats=1, cap=4.0,
        methods=("energy_conserving", "generalized_alpha"), dt=[5.0 / n for n in (250, 1000, 4000, 16_000)],
    )  # fmt: skip
    runs = [
        f"| {run.setting.method} | {run.setting.dt:.2g} s | {1e3 * run.seconds:.3g} ms "
        f"| {run.time.largest / study.reference.scale:.0e} | {'' if np.isnan(run.order) else f'{run.order:.1f}'} |"
        for run in study.runs
    ]
    return "\n\n".join(
        [
            "## Finite s0",
            "With `vf.Resolved(s0)` the switch is the variable-order operator at a finite scaling factor s0, not its "
            "limit. The motion tends to "
            f"that of the ideal switch like s0^-{slopes['penetration']:.1f} (penetration law) and "
            f"s0^-{slopes['displacement']:.1f} (displacement law), measured over the first three s0; below 1e-6 the "
            "steps of 5e-5 s show instead. Differences over 5 s, over the largest displacement:",
            "\n".join(lines),
            "event_driven does not apply to such a switch. The times of stepping methods (s0 = 1e4 1/m, 25 "
            "elements, 5 s, errors of the "
            f"steps; reference {study.reference.how}):",
            "\n".join(["| method | dt | time | error | order |", "| --- | ---: | ---: | ---: | ---: |", *runs]),
        ]
    )


_S0 = (1e2, 1e3, 1e4, 1e5)

# -- an industrial case -----------------------------------------------------------------------------


def tube_section() -> str:
    """Return the loosely supported tube: event_driven beside stepping methods."""
    t_end, times = 0.25, np.linspace(0.17, 0.25, 4001)
    settings: list[tuple[str, dict[str, float]]] = [("event_driven", {})]
    settings += [("energy_conserving", {"dt": dt}) for dt in (1e-4, 2.5e-5, 1e-5, 5e-6)]
    lines = [
        "| method | dt | first run | further runs | RMS force | tip, error |",
        "| --- | ---: | ---: | ---: | ---: | ---: |",
    ]
    exact, notes = None, ""
    for method, options in settings:
        say(f"the loosely supported tube, {method} {options}")
        # Kernels are read from disk before anything is timed.
        vf.simulate(loosely_supported_tube(), 0.01, method=method, **options)
        scene, taken = loosely_supported_tube(), []
        for _ in range(2):
            begin = time.perf_counter()
            result = vf.simulate(scene, t_end, times=times, method=method, **options)
            taken.append(time.perf_counter() - begin)
        stops = result.contacts
        force = stops["above 4"].force - stops["below 4"].force
        rms = float(np.sqrt(np.trapezoid(force**2, times) / (times[-1] - times[0])))
        tip = result.displacement(result.scene.bodies[0].at("right"))
        if exact is None:
            exact = tip
            notes = (
                f"{result.counters.events} events in {result.counters.statuses} statuses of the contacts; the energy "
                f"balance closes within {result.energy.balance_error:.0e}"
            )
        error = float(np.abs(tip - exact).max() / np.abs(exact).max())
        step = f"{options['dt']:.1e}" if options else ""
        off = f"{error:.1e}" if options else ""
        lines.append(f"| {method} | {step} | {taken[0]:.2f} s | {taken[1]:.2f} s | {rms:.3f} N | {off} |")
    return "\n\n".join(
        [
            "## An industrial case: events with dampers against steppers",
            "A tube of 2.4 m, 96 degrees of freedom, rattles between two-sided stops with dampers at four places under "
            "a harmonic load (code_aster SDNL301, 0.25 s; it is a case of `vofem verify`). Every set of closed "
            "contacts has "
            f"complex modes of its own, which event_driven computes from the real ones. There are {notes}. The first "
            "run computes these modes, and further runs use them again. The times of assembly and compiling are not "
            "included. The error is "
            "that of the tip from 0.17 to 0.25 s, over its largest displacement.",
            "\n".join(lines),
            "code_aster gives 23.98 N in 30 modes of a Timoshenko beam, and 24.53 N with four static shapes besides. "
            "Central differences would need steps below 3.2e-6 s.",
        ]
    )


# -- other programs, kernels, effects ---------------------------------------------------------------


def peer_section() -> str:
    found = side_by_side.measure(say)
    side_by_side.draw(found, FIGURES / "accuracy-peers.png")
    ours = side_by_side.best_of_ours(found, 1e-6)
    ratios = {one.name: one.time_to(1e-6)[0] / ours for one in found if not one.ours and one.errors}
    known = {name: ratio for name, ratio in ratios.items() if np.isfinite(ratio)}
    says = "No other program was installed."
    if known:
        nearest = min(known, key=lambda name: known[name])
        says = f"At 1e-6 the nearest program, {nearest}, takes {known[nearest]:.0f} times as long as vofem."
    missing = side_by_side.missing_lines(found)
    return "\n\n".join(
        part
        for part in (
            "## Side by side",
            "All programs compute the paper's beam on 25 elements under the penetration law over 20 s, with the same "
            "matrices or the same beam. They ran one after another on this machine. The time is the best of several "
            "runs, without the time for building the model. Errors "
            "are those in time, of the tip at 1001 times against event_driven on the same mesh (the equations "
            "multiplied by 3), which DOP853, restarted at events, confirms. Each program is used with settings that "
            "an experienced user would choose: "
            "OpenSeesPy with BandSPD and one iteration per step, Exudyn with modified Newton and sparse factors, numpy "
            "with both inverses cached, Radau with the Jacobian of each status, DOP853 restarted at events. The "
            f"highest frequency limits the step of DOP853, so it takes the same time for every error. {says}",
            "The table shows the seconds that a program needs to reach an error, and how many times as long as vofem "
            "it takes. Values with ~ are extrapolated with the slope of the last four runs; rounding errors may "
            "prevent a program from reaching such an error.",
            side_by_side.ratio_table(found),
            "![Error of the tip against wall time, all programs](figures/accuracy-peers.png)",
            missing,
            "Siconos is a Debian package (python3-siconos), which pip cannot install, and is left out; neither "
            "OpenSees nor Exudyn has the paper's displacement law.",
        )
        if part
    )


def kernel_section() -> str:
    return "\n\n".join(
        [
            "## Stepping kernels",
            "The table shows microseconds per step and, in brackets, the ratio to LAPACK's banded solve of the same "
            "size (pbtrs with a matrix that is already factored). A step of an implicit method consists of one such "
            "solve, products with banded matrices, and the contacts.",
            kernels.table(kernels.measure(say)),
            "The last table shows what a scene without contacts pays for features that it does not use. The first "
            "number is the time in microseconds of one step of a minimal loop: the same banded products and solves, "
            "but no work of loads, no stored states and no checks. The second number is vofem's time over it, the "
            f"median of {minimal.PAIRS} interleaved pairs. "
            "energy_conserving solves for the correction of an extrapolated velocity, which costs one more product "
            "and one more sweep than the plain midpoint rule. In return it conserves the energy over millions of "
            "steps. "
            "`python benchmarks/minimal.py` measures them alone.",
            minimal.table(minimal.measure(say)),
        ]
    )


def effect_section() -> str:
    return "\n\n".join(
        [
            "## What each effect costs",
            f"Milliseconds per simulated second of the cantilever on {effects.ELEMENTS} elements ({effects.T_END:g} s, "
            f"{effects.TIMES} stored times, dt = 1e-3 s; central differences at half their critical step), one thing "
            "added at a time. What a scene does not call for has counters of exactly zero, which are left out here; "
            "`tests/test_absent_effects.py` checks that it is neither built nor evaluated. Runs in time steps with "
            "contacts include the further runs that look for chaos and for errors of the steps (`nearby=`).",
            effects.table(effects.measure(say)),
        ]
    )


# -- response curves --------------------------------------------------------------------------------


def curve_section() -> str:
    results = response_curves.measure(say)
    panels = []
    for name, (exact, found) in results.items():
        curves = []
        for method, what in (
            ("shooting", "upper"), ("harmonic balance", "peak"), ("harmonic balance", "upper"),
            ("sweep up", "peak"), ("sweep up", "upper"), ("sweep down", "peak"), ("sweep down", "lower"),
        ):  # fmt: skip
            runs = [one for one in found if one.method == method and np.isfinite(getattr(one, what))]
            label = {"peak": "peak", "upper": "upper fold", "lower": "lower fold"}[what]
            if runs:
                off = [max(response_curves.errors(exact, one)[what], 1e-16) for one in runs]
                seconds = [one.seconds for one in runs]
                curves.append(Curve(f"{method}, {label}", seconds, off, strong=method == "shooting"))
        panels.append(Panel(curves, "processor time of the curve [s]", "relative error", name))
    log_curves(panels, FIGURES / "accuracy-curves.png")
    exact, found = results[response_curves.CASES[0].name]
    # The last sweep in each direction is the finest.
    off = {one.method: response_curves.errors(exact, one)["peak"] for one in found}
    return "\n\n".join(
        [
            "## Response curves",
            "Two response curves of the page on [steady states](steady-states.md): by shooting, by harmonic balance "
            "with 5 to 150 harmonics, and by sweeps, which run the scene at one frequency after the other and start "
            "each run at the end of the one before. The peak is the largest amplitude on the whole curve. Errors are "
            "relative to shooting with short steps, whose upper fold of the two masses agrees with an independent "
            "program to 12 digits. Times are processor times of the curve and of all its amplitudes, on "
            f"{machine()}. pyHarm-os, where it is listed, reports the peak of another measure, NLvib's.",
            "![Errors of peaks and folds against time](figures/accuracy-curves.png)",
            "What the methods miss:\n\n"
            "- **Shooting** finds all special points and the stability of every orbit. It accepts scenes that "
            "`event_driven` accepts, under loads that are sums of sines.\n"
            "- **Harmonic balance** finds folds, period doublings and Neimark-Sacker points; it lists no grazings. Its "
            "errors decrease with the number of harmonics at the rate of the kink in the contact force. The curve "
            "itself does not show them; the estimate `orbit.truncation` of each orbit does. Multipliers are those of "
            "exact orbits, so period doublings and Neimark-Sacker points are right for any number of harmonics. Few "
            "harmonics put the fold at a wrong frequency, and miss the period doubling beside it.\n"
            "- **Sweeps** find stable motions only, and a fold only up to the distance of two frequencies. Slow "
            "transients near a fold blur it further. From 0.7388 rad/s on, where the curve of the two masses loses "
            "its stability, an upward sweep shows other motions of other amplitudes; downwards it stays on the linear "
            "curve and misses the upper branch. More frequencies and more periods do not help: the finest sweeps miss "
            f"the peak of the two masses by {100 * off['sweep up']:.2g} % (upwards) and "
            f"{100 * off['sweep down']:.2g} % (downwards). The cantilever's peak lies on the stable part of its "
            "upper branch, which an upward sweep follows to the fold.",
            response_curves.table(results),
        ]
    )


SECTIONS: dict[str, Callable[[], str]] = {
    "beam": lambda: beam_section(beam_studies()),
    "orders": order_section,
    "explicit": explicit_section,
    "rounding": rounding_section,
    "chaos": chaos_section,
    "tolerance": tolerance_section,
    "resolved": resolved_section,
    "tube": tube_section,
    "curves": curve_section,
    "peers": peer_section,
    "kernels": kernel_section,
    "effects": effect_section,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", choices=tuple(SECTIONS), help="measure these anew, and keep the others")
    arguments = parser.parse_args()
    for folder in (FIGURES, STORE):
        folder.mkdir(parents=True, exist_ok=True)
    # Each section is kept as soon as it is known: a study that is stopped loses one of them.
    for name in arguments.only or SECTIONS:
        (STORE / f"{name}.md").write_text(SECTIONS[name](), encoding="utf-8")
    kept = [STORE / f"{name}.md" for name in SECTIONS]
    missing = [path.stem for path in kept if not path.exists()]
    if missing:
        say(f"docs/accuracy.md stays as it is: not yet measured are {', '.join(missing)}")
        return
    head = "\n\n".join(
        [
            "# What accuracy costs in time",
            "Written by `make accuracy` (`python benchmarks/accuracy_page.py`); change that, not the page. For a scene "
            "of yours: `vofem accuracy SCENE.toml`, `vf.accuracy.work_precision` and `vf.accuracy.cheapest`.",
            f"Measured on {machine()}. Times vary with the machine and its load, ratios less so.",
        ]
    )
    parts = [path.read_text(encoding="utf-8") for path in kept]
    (DOCS / "accuracy.md").write_text("\n\n".join([head, *parts]) + "\n", encoding="utf-8")
    say("wrote docs/accuracy.md")


if __name__ == "__main__":
    main()
