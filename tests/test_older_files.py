"""Files of an earlier version are read: names in a file outlive the modules in which classes are kept.

``python tests/test_older_files.py NAME`` writes the run of a new case into ``tests/data/saved``; files that are there
stay as an earlier version wrote them.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import vofem as vf
from vofem.files.hdf5 import reading, writing
from vofem.io.storage.tree import class_named, read_tree, write_text

pytestmark = pytest.mark.kernels("plain")

SAVED = Path(__file__).parent / "data" / "saved"

T_END = 2.0
TIMES = np.linspace(0.0, T_END, 11)


def loads():
    """A beam and a mass under every named function of time."""
    beam = vf.Beam(1.0, 1.0, 1.0, 3, {"left": "clamped"}, name="beam")
    ball = vf.Mass(0.3, stiffness=2.0, damping=0.05, name="ball")
    tip, table = beam.at(1.0), vf.Tabulated([0.0, 0.7, 2.0], [0.0, 0.4, -0.3])
    effects = [
        vf.Contact(tip, gap=0.01, stiffness=20.0, side="below", acts_on="penetration", name="stop"),
        vf.PointLoad(tip, 0.1 * vf.Sine(1.0, 3.0) + vf.Pulse(-0.3, 0.5, 0.4) + vf.Constant(0.01)),
        vf.PointLoad(ball, vf.Ramp(0.5, 0.1, 0.9)),
        vf.PointLoad(ball, vf.Approximated(lambda t: 0.1 * t**2, t_end=3.0, tolerance=1e-3)),
        vf.BaseMotion(ball, table),
        vf.BaseMotion(beam, table),
        vf.Spring(tip, ball, stiffness=0.5),
    ]
    return vf.Scene([beam, ball], effects), {"method": "energy_conserving", "dt": 0.01}


def springs():
    """Springs of every kind with a step."""
    one, two = vf.Mass(1.0, name="one"), vf.Mass(1.0, stiffness=1.0, name="two")
    effects = [
        vf.HystereticSpring(one, stiffness=4.0, linear_limit=0.05, memory="cyclic", name="yields"),
        vf.BilinearSpring(two, stiffness=3.0, linear_limit=0.1, hardening=0.1, name="slips"),
        vf.Springpot(one, two, coefficient=0.2, order=0.5, name="creeps"),
        vf.Contact(one, two, gap=0.1, stiffness=50.0, acts_on="penetration", name="hit"),
        vf.PointLoad(one, vf.Sine(0.5, 2.0)),
        vf.RayleighDamping(0.1, 0.01),
    ]
    return vf.Scene([one, two], effects), {"method": "energy_conserving", "dt": 0.02}


CASES = {"loads": loads, "springs": springs}


@pytest.fixture(scope="module", params=CASES)
def older(request, tmp_path_factory):
    """An older file, read, and the run that it holds, made now."""
    path = tmp_path_factory.mktemp("older") / f"{request.param}.vtkhdf"
    path.write_bytes(gzip.decompress((SAVED / f"{path.name}.gz").read_bytes()))
    scene, arguments = CASES[request.param]()
    return vf.load(path), vf.simulate(scene, T_END, times=TIMES, **arguments), arguments


def apart(found, anew):
    """Return the largest difference of the last body's displacements, relative to the largest of them."""
    body = anew.scene.bodies[-1]
    was, now = found.displacement(body), anew.displacement(body)
    return np.max(np.abs(was - now)) / np.max(np.abs(now))


def assert_same_motion(found, anew):
    assert apart(found, anew) < 1e-9


def test_an_older_run_is_read(request, older):
    """What a file holds is what the version that wrote it reads from it; see ``tests/data/README.md``."""
    found, anew, arguments = older
    read_then = json.loads((SAVED / "displacements.json").read_text())[request.node.callspec.params["older"]]
    now = found.displacement(found.scene.bodies[-1])
    assert np.max(np.abs(now - read_then)) < 1e-9 * np.max(np.abs(read_then))
    # The older version took loads at the middles of steps, this one takes their means over steps. Both rules are of
    # second order: the runs differ by less than the error of the steps, which a run with an eighth of the step shows.
    fine = vf.simulate(anew.scene, T_END, times=TIMES, **arguments | {"dt": arguments["dt"] / 8})
    assert apart(found, anew) < apart(fine, anew) < 2e-3
    assert found.energy.balance_error < 1e-9
    assert found.contacts.keys() == anew.contacts.keys()
    assert found.springs.keys() == anew.springs.keys()


def test_an_older_scene_runs_again(older):
    found, anew, arguments = older
    assert_same_motion(vf.simulate(found.scene, T_END, times=TIMES, **arguments), anew)


#: Modules that the classes in files of earlier versions were named by.
NAMES = ["vofem.assembly:Model", "vofem.simulate:Plan", "vofem.effects.time_functions:Arbitrary"] + [
    f"vofem.effects.time_functions:{name}"
    for name in ("Constant", "Piece", "Pulse", "Ramp", "Scaled", "Sine", "Sum", "Tabulated")
]
NAMES += ["vofem.effects.time_functions.base:Sum", "vofem.effects.time_functions.named:Constant"]
NAMES += ["vofem.effects.approximated:Approximated", "vofem.integrators.event_driven.lifted:Truncation"]


@pytest.mark.parametrize("name", NAMES)
def test_earlier_names_of_classes_are_known(name):
    assert class_named(name).__name__ == name.partition(":")[2]


#: Classes of checkpoints that have other names now.
RENAMED = {
    "vofem.integrators.stepping.record:Trail": "LastStep",
    "vofem.laws.springpot:History": "SpringpotState",
    "vofem.integrators.generalized_alpha:_State": "State",
    "vofem.integrators.central_difference:_State": "State",
    "vofem.integrators.energy_conserving.step:State": "State",
}


@pytest.mark.parametrize("name", RENAMED)
def test_classes_of_earlier_checkpoints_are_known(name):
    assert class_named(name).__name__ == RENAMED[name]


def test_the_past_of_springpots_in_earlier_checkpoints_is_read(tmp_path):
    with writing(tmp_path / "a.h5") as blocks:
        fields = '{"y": 1.0, "told": 2.0}'
        write_text(blocks.file, "tree", f'{{"data": "vofem.laws.springpot:History", "number": 0, "fields": {fields}}}')
    with reading(tmp_path / "a.h5") as file:
        assert tuple(read_tree(file)) == (1.0, 2.0)


def test_internal_variables_in_earlier_checkpoints_are_read(tmp_path):
    with writing(tmp_path / "a.h5") as blocks:
        fields = '{"q": 1.0, "v": 2.0, "memory": 3.0}'
        write_text(blocks.file, "tree", f'{{"data": "vofem.system:State", "number": 0, "fields": {fields}}}')
    with reading(tmp_path / "a.h5") as file:
        assert read_tree(file).internal == 3.0


def test_fields_that_came_later_have_their_defaults(tmp_path):
    with writing(tmp_path / "a.h5") as blocks:
        data = '{"data": "vofem.effects.time_functions:Ramp", "number": 0, "fields": {"slope": 2.0, "start": 1.0}}'
        write_text(blocks.file, "tree", data)
    with reading(tmp_path / "a.h5") as file:
        assert read_tree(file) == vf.Ramp(2.0, 1.0)


@pytest.mark.parametrize("fields", ['"start": 1.0', '"slope": 2.0, "start": 1.0, "curvature": 3.0'])
def test_fields_without_defaults_must_be_there_and_unknown_ones_not(fields, tmp_path):
    with writing(tmp_path / "a.h5") as blocks:
        data = f'{{"data": "vofem.effects.time_functions:Ramp", "number": 0, "fields": {{{fields}}}}}'
        write_text(blocks.file, "tree", data)
    with pytest.raises(vf.StorageError, match="version that wrote it"), reading(tmp_path / "a.h5") as file:
        read_tree(file)


def write(name):
    """Write a run as the version at hand does."""
    scene, arguments = CASES[name]()
    path = vf.simulate(scene, T_END, times=TIMES, **arguments).save(SAVED / f"{name}.vtkhdf", frames=1)
    (SAVED / f"{path.name}.gz").write_bytes(gzip.compress(path.read_bytes(), mtime=0))
    path.unlink()


if __name__ == "__main__":
    write(sys.argv[1])
