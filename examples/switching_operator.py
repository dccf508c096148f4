"""The operator on a constant as a switch (Eq. 8): s(t) = t(t-3)(t-3.5)(t-4)(t-4.5)(t-5), C0 = 2, s0 = 1e5 per metre.

The constant is there where s > 0 and gone where not; how sharply, the closing at t = 3 s shows. Run it with
``python examples/switching_operator.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vofem import fractional
from vofem.io.pictures.axes import COLORS, INK, legend, panels, save

ROOTS = (0.0, 3.0, 3.5, 4.0, 4.5, 5.0)
C0, S0 = 2.0, 1e5


def s(t: np.ndarray) -> np.ndarray:
    """Return the gap function of section 3 in m."""
    return np.prod([t - root for root in ROOTS], axis=0)


def main(output: Path) -> tuple[np.ndarray, np.ndarray]:
    """Print where the operator switches and draw it; return delays after the closing at 3 s and levels there."""
    output.mkdir(parents=True, exist_ok=True)
    slope = float(np.prod([3.0 - root for root in ROOTS if root != 3.0]))
    print("t [s]     s [m]      ideal   resolved")
    for t in (1.0, 3.25, 3.75, 4.25, 4.75, 5.25):
        gap = s(np.array(t))
        print(f"{t:5.2f}   {gap:8.4f}   {fractional.ideal(C0, gap):6.1f}   {fractional.resolved(C0, gap, S0):8.1f}")
    delays = np.array([0.100, 0.585, 1.907]) / (S0 * slope)
    levels = fractional.resolved(C0, slope * delays, S0)
    print(f"\nclosing at 3 s, ds/dt = {slope:g} m/s, s0 = {S0:g} 1/m")
    for delay, level in zip(delays, levels, strict=True):
        print(f"  {level / C0:4.0%} of C0 after {1e6 * delay:.3f} us")

    figure, grid = panels((11.0, 6.4), 2, 2, width_ratios=(1.6, 1.0))
    t = np.linspace(2.7, 5.3, 2601)
    closed = s(t) > 0.0
    for axes in grid[:, 0]:
        axes.fill_between(t, 0, 1, where=closed, transform=axes.get_xaxis_transform(), color="#fdf0e3", linewidth=0)
        axes.set_xlim(t[0], t[-1])
    grid[0, 0].plot(t, s(t), color=INK)
    grid[0, 0].axhline(0.0, color=COLORS[5], linewidth=1.0, linestyle="--")
    grid[0, 0].set(ylabel="s [m]", title="gap function; shaded where s > 0", ylim=(-1.0, 1.0))
    grid[1, 0].plot(t, fractional.resolved(C0, s(t), S0), color=COLORS[0], linewidth=2.0)
    grid[1, 0].set(xlabel="time [s]", ylabel="operator on C0 = 2", title="the operator, order exp(-s0 s)")
    near = np.linspace(-1.0, 12.0, 1301) * 1e-6
    gap = slope * near
    grid[0, 1].plot(1e6 * near, fractional.exponential_order(gap, S0), color=COLORS[3])
    grid[0, 1].axhline(1.0, color=COLORS[5], linewidth=1.0, linestyle="--")
    grid[0, 1].set(ylabel="order", title="closing at 3 s, close up")
    sign, log = fractional.literal(C0, gap, S0, 3.0)
    grid[1, 1].plot(1e6 * near, fractional.ideal(C0, gap), color=COLORS[1], label="ideal")
    grid[1, 1].plot(1e6 * near, fractional.resolved(C0, gap, S0), color=COLORS[0], linewidth=2.0, label="resolved")
    grid[1, 1].plot(1e6 * near, sign * np.exp(log), color=COLORS[4], linestyle=":", label="literal, t = 3 s")
    grid[1, 1].set(xlabel="time after 3 s [µs]", ylabel="operator on C0 = 2")
    legend(grid[1, 1])
    for axes in grid.flat:
        axes.title.set_fontsize(11)
    print(f"\nwrote {save(figure, output / 'switching-operator.png')}")
    return delays, levels


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figure")
    main(parser.parse_args().output)
