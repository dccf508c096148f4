"""Random sweeps beside a plain loop: whatever points do, however often the sweep is stopped, the table is the same.

`python tests/test_hunt_sweeps.py FIRST LAST` runs the sweeps of many seeds and prints what it finds.
"""

import functools
import itertools
import os
import random
import shutil
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from campaigns import campaign

import vofem as vf
from vofem.studies.sweep import SweepInterrupted

#: Values of the axes, by kind.
AXES = {
    "number": [-1.5, 0.0, 2, 1e-300, -7, 3.25, 1e9, 0.1],
    "text": ["", "a", "long name", "ä", "a/b"],
    "truth": [True, False],
    "list": [[1.0, 2.0], [], [3]],
}


def case(rng):
    """Return points, and the same points as a list of dicts."""
    axes = {}
    for name in rng.sample("abc", rng.randint(1, 3)):
        values = AXES[rng.choice(list(AXES))]
        axes[name] = rng.sample(values, rng.randint(1, len(values)))
    rows = [dict(zip(axes, values, strict=True)) for values in itertools.product(*axes.values())]
    if rng.random() < 0.3:
        rows = rng.choices(rows, k=rng.randint(1, 12))
        return rows, rows
    return axes, rows


def returned(seed, point):
    """Return what the function returns at a point, or raise."""
    own = random.Random(f"{seed} {sorted(point.items())}")
    every = random.Random(seed)
    values = {}
    for name in every.sample(["x", "y", "z", "error"], every.randint(1, 4)):
        kind, length = every.choice(["float", "int", "bool", "text", "complex"]), every.choice([None, 0, 3])
        make = {
            "float": lambda: own.choice([own.gauss(0.0, 1.0), float("nan"), float("inf"), -0.0]),
            "int": lambda: own.randint(-(2**60), 2**60),
            "bool": lambda: own.random() < 0.5,
            "text": lambda: own.choice(["", "b", "a longer text", "ö"]),
            "complex": lambda: complex(own.random(), own.random()),
        }[kind]
        typed = {"float": float, "int": int, "bool": bool, "text": str, "complex": complex}[kind]
        values[name] = make() if length is None else np.array([make() for _ in range(length)], dtype=typed)
    trouble = own.random() if every.random() < 0.6 else 1.0
    if trouble < 0.1:
        raise ValueError("no such point")
    if trouble < 0.2:
        return values | {next(iter(values)): own.choice(["odd", 1j, [1.0, 2.0], None])}
    if trouble < 0.25:
        return values | {"more": 1.0}
    return values


def kind_of(value):
    value = np.asarray(value)
    return ("number" if value.dtype.kind in "biuf" else value.dtype.kind), value.shape


def expected(seed, rows):
    """Return the columns as lists, with None where a point fails: it raises, or differs in kind from the first."""
    found, pattern = [], None
    for row in rows:
        try:
            values = returned(seed, row)
        except ValueError:
            values = None
        if values is not None and any(kind_of(value)[0] == "O" for value in values.values()):
            values = None
        if values is not None:
            mine = {name: kind_of(value) for name, value in values.items()}
            pattern = mine if pattern is None else pattern
            values = values if mine == pattern else None
        found.append(values)
    return found


def differences(table, right):
    """Return what a table has otherwise than the plain loop, or None."""
    if [one.index for one in table.failed] != [k for k, values in enumerate(right) if values is None]:
        return f"failed {[one.index for one in table.failed]}"
    names = next((list(values) for values in right if values is not None), [])
    if list(table) != names:
        return f"quantities {list(table)}, expected {names}"
    for name in names:
        column = table[name].reshape(len(right), *table[name].shape[len(table.points.shape) :])
        for got, values in zip(column, right, strict=True):
            want = None if values is None else np.asarray(values[name])
            if want is None:
                fine = got.dtype.kind == "U" and np.all(got == "")
                fine = fine or got.size == 0 or (got.dtype.kind in "fc" and np.all(np.isnan(got)))
            else:
                fine = got.shape == want.shape and np.array_equal(got, want, equal_nan=want.dtype.kind in "fc")
                # Integers and truths become floats where a point failed, or where other points gave floats.
                fine = fine or (want.dtype.kind in "bi" and np.array_equal(got, want.astype(float)))
            if not fine:
                return f"{name}: {got!r}, expected {want!r}"
    return None


def function(seed, **point):
    """The function of all sweeps; it is stopped by Ctrl-C at the calls whose numbers the environment holds.

    The files that the process would leave if it were killed there are copied.
    """
    # What a function reaches in its own module belongs to its identity, and must not change.
    calls, *stops = os.environ["HUNT_STOPS"].split()
    os.environ["HUNT_STOPS"] = " ".join([str(int(calls) + 1), *stops])
    if calls in stops:
        shutil.copytree(os.environ["HUNT_FOLDER"], os.environ["HUNT_KILLED"])
        raise KeyboardInterrupt
    return returned(seed, point)


def fault(seed):
    """Return what is wrong with the sweeps of a seed, or None."""
    rng = random.Random(seed)
    points, rows = case(rng)
    right, work = expected(seed, rows), functools.partial(function, seed)
    run = functools.partial(vf.sweep, work, points, compiled=False)
    os.environ["HUNT_STOPS"] = "0"
    if found := differences(run(executor="serial"), right):
        return f"serial: {found}"
    with ThreadPoolExecutor(3) as threads:
        if found := differences(run(executor=threads), right):
            return f"threads: {found}"
    with tempfile.TemporaryDirectory() as base:
        folder, killed = Path(base, "folder"), Path(base, "killed")
        folder.mkdir()
        store = folder / "rows.h5"
        os.environ["HUNT_FOLDER"], os.environ["HUNT_KILLED"] = str(folder), str(killed)
        os.environ["HUNT_STOPS"] = " ".join(["0", *(str(rng.randint(0, 2 * len(rows))) for _ in range(3))])
        for _ in range(5):
            try:
                table = run(executor="serial", store=store)
                break
            except SweepInterrupted as error:
                stopped = error
            if not stopped.sweep.missing:
                return "nothing is said of points that were not reached"
            if rng.random() < 0.5:
                shutil.rmtree(folder)
                shutil.copytree(killed, folder)
                (folder / "rows.h5.lock").unlink()
                log = folder / "rows.h5.sqlite-wal"
                if log.exists() and rng.random() < 0.5:
                    # The last transaction was being written.
                    log.write_bytes(log.read_bytes()[: rng.randint(0, log.stat().st_size)])
            shutil.rmtree(killed)
        else:
            return "does not end"
        if found := differences(table, right):
            return f"after interruptions: {found}"
        again, loaded = run(executor="serial", store=store), vf.load(store)
        if again.counters["computed"]:
            return f"{again.counters['computed']} rows were computed again"
        if found := differences(again, right) or (len(loaded.points.rows) == len(rows) and differences(loaded, right)):
            return f"stored: {found}"
        if [path.name for path in folder.iterdir()] != ["rows.h5"]:
            return f"files {list(folder.iterdir())}"
    return None


@pytest.mark.parametrize("seed", range(24))
def test_the_table_is_that_of_a_loop(seed):
    assert fault(seed) is None


if __name__ == "__main__":
    campaign(fault)
