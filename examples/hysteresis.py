"""Section 4.3: a spring that softens beyond 5 m, loaded to 4, 6 and 7 N and unloaded; and what reloading does.

Eq. 25 (operators), Eq. 26 (integer order) and the law that remembers draw the same curves under one loading and one
unloading. On reloading the printed law forgets. Run it with ``python examples/hysteresis.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import vofem as vf
from vofem.io.pictures.axes import COLORS, INK, panels, save

CASES = {"a": 4.0, "b": 6.0, "c": 7.0}
ONE_LOADING = np.concatenate([np.linspace(0.0, 1.0, 141), np.linspace(1.0, 0.0, 71)[1:]])
RELOADING = np.concatenate(
    [np.linspace(a, b, 100, endpoint=False) for a, b in ((0.0, 7.0), (7.0, 3.0), (3.0, 7.5), (7.5, 0.0))] + [[0.0]]
)


def spring_on(mass: vf.Mass, memory: str) -> vf.HystereticSpring:
    """Return the paper's spring: K = 1 N/m, d0 = 5 m, Eq. 24."""
    return vf.HystereticSpring(mass, stiffness=1.0, linear_limit=5.0, memory=memory, name="spring")


def path(memory: str, forces: np.ndarray) -> np.ndarray:
    """Return the displacements under forces in N that change slowly."""
    mass = vf.Mass(1.0, name="mass")
    scene = vf.Scene([mass], [spring_on(mass, memory), vf.PointLoad(mass, 1.0)])
    return vf.quasi_static(scene, forces).displacement(mass)


def integer_order(forces: np.ndarray) -> np.ndarray:
    """Return the displacements by Eq. 26: K by its branches, the residual elongation from the largest load."""
    spring = spring_on(vf.Mass(1.0), "printed")
    top = int(np.argmax(forces))
    xi = np.empty(forces.size)
    for n, force in enumerate(forces):
        rising = n <= top
        # Eq. 26 asks whether the displacement is beyond d0: it is where a linear spring's would be.
        linear = force / spring.stiffness
        residual = 0.0 if rising else xi[top] - forces[top] / spring.stiffness
        xi[n] = residual + force / spring.integer_stiffness(linear, force, rising)
    return xi


def draw_cases(axes: Any, paths: dict[str, np.ndarray]) -> None:
    """Draw load over displacement with the regimes of Eq. 23."""
    regimes = ((0.0, 5.0, "#eef3f8", "I  linear"), (5.0, 15.0, "#fdf0e3", "II  nonlinear"))
    for left, right, color, name in regimes:
        axes.axvspan(left, right, color=color, linewidth=0)
        axes.text(left + 0.25, 8.55, name, color=INK, fontsize=10)
    axes.axhline(9.0, color=COLORS[4], linewidth=1.2, linestyle="--")
    axes.text(14.8, 9.1, "limit load 9 N: no equilibrium from here on", color=COLORS[4], fontsize=9, ha="right")
    xi = np.linspace(14.0, 15.0, 11)
    axes.plot(xi, 9.0 * xi / (4.0 + xi), color=COLORS[5], linewidth=1.0, linestyle=":")
    for k, (name, top) in reversed(list(enumerate(CASES.items()))):
        forces = top * ONE_LOADING
        label = f"case {name}: to {top:g} N, {paths[name][140]:g} m, back to {paths[name][-1]:g} m"
        axes.plot(paths[name], forces, color=COLORS[k], linewidth=4.5 - 1.2 * (2 - k), label=label, alpha=0.9)
        part = slice(None, None, 14)
        axes.plot(integer_order(forces)[part], forces[part], "o", color=INK, markersize=3.2, zorder=5)
        axes.plot(paths[name][-1], 0.0, "s", color=COLORS[k], markersize=7, clip_on=False, zorder=6)
    axes.plot([], [], "o", color=INK, markersize=3.2, label="Eq. 26, integer order")
    axes.annotate(
        "III  unloading at K,\nresidual elongation 7 m", (10.0, 3.0), (10.7, 1.6), color=INK, fontsize=10,
        arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.8},
    )  # fmt: skip
    axes.set(xlabel="displacement [m]", ylabel="load [N]", xlim=(0.0, 15.0), ylim=(0.0, 9.8))
    axes.set_title("one loading, one unloading (Eq. 25)")


def draw_reloading(axes: Any, paths: dict[str, np.ndarray]) -> None:
    """Draw both laws under load, partial unloading and more load."""
    for name, color, width in (("cyclic", COLORS[1], 5.5), ("printed", COLORS[0], 1.9)):
        xi = paths[name].copy()
        jump = int(np.argmin(np.diff(xi))) + 1 if name == "printed" else xi.size
        axes.plot(xi[:jump], RELOADING[:jump], color=color, linewidth=width, label=f'memory="{name}"')
        axes.plot(xi[jump:], RELOADING[jump:], color=color, linewidth=width)
        if jump < xi.size:
            start, end = (xi[jump - 1], RELOADING[jump - 1]), (xi[jump], RELOADING[jump])
            axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": COLORS[4], "linewidth": 1.8})
            axes.text(6.5, 2.35, "first step of reloading:\n10 m to 3 m", color=COLORS[4], ha="center", fontsize=9,
                      va="top")  # fmt: skip
    axes.set(xlabel="displacement [m]", xlim=(0.0, 21.0), ylim=(0.0, 9.8))
    axes.set_title('reloading: the printed law forgets, so cycles need memory="cyclic"')


def main(output: Path) -> dict[str, Any]:
    """Print peaks and residual elongations of all three cases, and draw both figures in one."""
    output.mkdir(parents=True, exist_ok=True)
    single = {name: path("printed", top * ONE_LOADING) for name, top in CASES.items()}
    print("case  load [N]  peak [m]  residual [m]  Eq. 25 - Eq. 26 [m]  printed - cyclic [m]")
    for name, top in CASES.items():
        forces, xi = top * ONE_LOADING, single[name]
        apart = [np.max(np.abs(xi - other)) for other in (integer_order(forces), path("cyclic", forces))]
        print(f"{name:>4}{top:10g}{xi[140]:10g}{xi[-1]:14g}{apart[0]:21.1e}{apart[1]:22.1e}")
    reloading = {memory: path(memory, RELOADING) for memory in ("printed", "cyclic")}
    start = 200
    print(f"\nreloading from {RELOADING[start]:g} N, at {reloading['printed'][start]:g} m; at the first step")
    for memory, xi in reloading.items():
        print(f"  {memory:8} {xi[start + 1]:.4f} m at {RELOADING[start + 1]:.4f} N")

    figure, grid = panels((13.0, 5.4), 1, 2)
    draw_cases(grid[0, 0], single)
    draw_reloading(grid[0, 1], reloading)
    for axes in grid[0]:
        axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, frameon=False, fontsize=9)
    print(f"\nwrote {save(figure, output / 'hysteresis.png')}")
    return {"single": single, "reloading": reloading}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figure")
    main(parser.parse_args().output)
