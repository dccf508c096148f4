"""Contact point and stiffness of a soft sample from a force-distance curve of an atomic force microscope.

A piezo lowers a cantilever onto a sample, and a laser measures its deflection. While the tip is free the deflection is
constant. From the contact point on the sample carries a part of the travel, so that the slope gives its stiffness. Seen
from the frame of the microscope, lowering the base by d does to the tip what a load of -k d does to a cantilever whose
base rests, k being its spring constant. So `vofem.fit` finds the gap of a contact and its stiffness from equilibria.

What the model leaves out: the sample is a linear spring, while a rounded tip sinks in with a growing contact area
(Hertz); adhesion and attraction before contact; viscosity of sample and liquid; the tilt of the cantilever; errors of
the spring constant and of the sensitivity of the laser. The residuals show the first of these: close to the contact
point they exceed the noise and bend as a growing contact area does.

The curve in ``afm_contact.csv`` is every third point of the last 0.8 um of an approach; its source is written there.
Run the example with ``python examples/afm_contact.py --output output``, or with ``--file`` and a file of your own
microscope, for which ``pip install "vofem[afm]"`` installs the reader.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import vofem as vf
from vofem.io import plot

#: Last part of the approach that is fitted, m; and how many points lie between those that are taken.
REACH, EVERY = 8e-7, 3

#: Length of the cantilever, m. Only its spring constant matters; no mass does.
LENGTH = 2e-4

Vector = NDArray[np.float64]


def curve(file: Path | None) -> tuple[Vector, Vector, float, float]:
    """Return travel and deflection in m, the spring constant in N/m, and the noise of the deflection in m."""
    if file is None:
        path = Path(__file__).with_suffix(".csv")
        header = next(line for line in path.read_text().splitlines() if line.startswith("# spring constant"))
        stiffness, noise = (float(part.split()[-2]) for part in header[2:].split(","))
        travel, deflection = np.loadtxt(path, delimiter=",").T
        return travel, deflection, stiffness, noise
    import afmformats

    data = afmformats.load_data(file)[0]
    stiffness = float(data.metadata["spring constant"])
    height, deflection = data.appr["height (measured)"], data.appr["force"] / stiffness
    travel = height.max() - height
    # The noise is that of the first half, in which the tip is free and a straight line is taken off.
    half = slice(0, travel.size // 2)
    noise = float(np.std(deflection[half] - np.polyval(np.polyfit(travel[half], deflection[half], 1), travel[half])))
    part = np.flatnonzero(travel > travel.max() - REACH)
    chosen = slice(int(part[0]), None, EVERY)
    return travel[chosen], deflection[chosen], stiffness, noise


def fitted(travel: Vector, deflection: Vector, stiffness: float, noise: float) -> vf.Fit:
    """Return the fit of contact point and stiffness of the sample. Times stand for travel: a second is a micrometre."""
    cantilever = vf.Beam(
        LENGTH, EI=stiffness * LENGTH**3 / 3.0, rhoA=1e-7, elements=1, supports={"left": "clamped"}, name="cantilever"
    )
    tip = cantilever.at(LENGTH)
    approach = vf.PointLoad(tip, vf.Ramp(-1e-6 * stiffness, 0.0, 1e6 * float(travel.max()) + 1.0))
    # The deflection leaves its first value where the tip meets the sample; the sample is as stiff as the cantilever.
    meets = travel[np.argmax(deflection - deflection[0] > 0.1 * np.ptp(deflection))]
    sample = vf.Contact(tip, gap=float(meets), stiffness=stiffness, side="below", acts_on="penetration", name="sample")
    # The tip is lower than the base by what the piezo has travelled, less the deflection.
    data = vf.MeasuredStatics(tip, 1e6 * travel, deflection - travel, noise, offset=True)
    return vf.fit(
        vf.Scene([cantilever], [approach, sample]), [vf.Parameter(sample, "gap"), vf.Parameter(sample, "stiffness")],
        data,
    )  # fmt: skip


def main(output: Path, file: Path | None = None) -> vf.Fit:
    """Fit the curve, print contact point and stiffness, and draw the residuals."""
    travel, deflection, stiffness, noise = curve(file)
    found = fitted(travel, deflection, stiffness, noise)
    (gap, own), (gap_error, own_error) = found.values, found.deviation
    rms = float(np.sqrt(np.mean(found.residuals**2)))
    print(f"contact point after {1e6 * gap:.4f} um of travel, +- {1e9 * gap_error:.2f} nm by the noise alone")
    print(f"stiffness of the sample {own:.5f} N/m, +- {own_error:.5f} N/m; of the cantilever {stiffness:.5f} N/m")
    print(f"residuals of {1e9 * rms:.2f} nm (rms) with a noise of {1e9 * noise:.2f} nm: what the model leaves out")
    print(f"wrote {plot.fit(found, output / 'afm_contact.png')}")
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--output", type=Path, default=Path("output"))
    parser.add_argument("--file", type=Path, help="a force-distance curve that afmformats reads")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    main(arguments.output, arguments.file)
