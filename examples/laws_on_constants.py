"""The three laws for the operator on a constant, side by side over gap function and time.

The ideal and the resolved law stay within [0, K0]; the literal formula (Eq. 4 with Eq. 5) leaves it on either side of
the contact. Run it with ``python examples/laws_on_constants.py --output output``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from vofem import fractional
from vofem.io.pictures.axes import COLORS, INK, panels, save

S0 = 1e3


def literal(s: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Return the literal formula for K0 = 1, cut off at the range of doubles."""
    sign, log = fractional.literal(1.0, s, S0, t)
    return sign * np.exp(np.minimum(log, 700.0))


def main(output: Path) -> dict[str, float]:
    """Print where and how far the literal formula leaves [0, K0], and draw all three laws."""
    output.mkdir(parents=True, exist_ok=True)
    s = np.linspace(-3.0, 5.0, 4001) / S0
    numbers = {"bound": float(np.exp(-np.euler_gamma))}
    print(f"K0 = 1 N/m, s0 = {S0:g} 1/m\n\nin contact (s > 0): largest value of the literal formula")
    for t in (0.05, 0.1, 0.3, numbers["bound"], 1.0, 10.0):
        side = s[s > 0.0]
        value = literal(side, np.array(t))
        top = int(np.argmax(value))
        numbers[f"peak {t:.4g}"] = float(value[top])
        print(f"  t = {t:7.4f} s: {value[top]:.4f} K0 at s = {1e3 * side[top]:.3f} mm")
    print("\nopen (s < 0): the literal formula at t = 1 s")
    for gap in (-0.3e-3, -1e-3, -2e-3, -5e-3, -6e-3):
        sign, log = fractional.literal(1.0, gap, S0, 1.0)
        numbers[f"open {1e3 * gap:g}"] = float(sign * log / np.log(10.0))
        power = f"10^{log / np.log(10.0):.4g}"
        print(f"  s = {1e3 * gap:5.1f} mm: {'-+'[int(sign > 0)]}{power} K0")

    s, times = s[::4], np.geomspace(0.05, 10.0, 501)
    resolved = np.broadcast_to(fractional.resolved(1.0, s, S0), (len(times), len(s)))
    ideal = np.broadcast_to(fractional.ideal(1.0, s), resolved.shape)
    figure, grid = panels((12.0, 4.9), 1, 3, sharey=True)
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.patches import Patch

    shades = LinearSegmentedColormap.from_list("level", ["#f4f5f7", "#8f9bb0", INK])
    shades = shades.with_extremes(under=COLORS[1], over=COLORS[0])
    laws = {"ideal": ideal, "resolved": resolved, "literal": literal(s[None, :], times[:, None])}
    for axes, (name, value) in zip(grid[0], laws.items(), strict=True):
        image = axes.pcolormesh(1e3 * s, times, value, cmap=shades, vmin=0.0, vmax=1.0, rasterized=True)
        axes.set(title=name, xlabel="s [mm]", yscale="log")
        axes.axvline(0.0, color=COLORS[5], linewidth=1.0)
    grid[0, 0].set_ylabel("time [s]")
    grid[0, 0].set_yticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
    figure.colorbar(image, ax=grid[0, -1], label="value / K0")
    handles = [Patch(color=COLORS[0], label="above K0"), Patch(color=COLORS[1], label="below 0")]
    figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    print(f"\nwrote {save(figure, output / 'laws-on-constants.png')}")
    return numbers


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("output"), help="folder for the figure")
    main(parser.parse_args().output)
