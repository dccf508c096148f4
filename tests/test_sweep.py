"""Sweeps: the same table on every executor, after every interruption, and whatever a point does."""

import functools
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
import sweep_functions as functions

import vofem as vf
from vofem.blas import blas_threads
from vofem.io import plot
from vofem.kernels.mode import compiled
from vofem.studies.sweep import SweepInterrupted, running
from vofem.studies.sweep import store as store_module
from vofem.studies.sweep.identity import identity

TESTS = Path(__file__).parent
GRID = {"omega": [0.4, 0.7, 1.1], "gap": [0.0, 0.2]}


def same(first, second):
    """Return whether two tables hold the same bits."""
    return list(first) == list(second) and all(
        first[name].dtype == second[name].dtype and first[name].tobytes() == second[name].tobytes() for name in first
    )


# -- points -------------------------------------------------------------------------------------------


def test_a_grid_has_the_shape_of_its_lists_and_the_last_name_changes_fastest():
    table = vf.sweep(functions.square, {"x": [1, 2, 3]}, executor="serial")
    assert table["y"].tolist() == [3.5, 7.5, 13.5]
    assert table["series"].shape == (3, 3)
    assert table["large"].dtype == bool
    assert table["label"].tolist() == ["p1", "p2", "p3"]
    grid = vf.sweep(lambda a, b: {"sum": 10 * a + b}, {"a": [1, 2], "b": [3, 4, 5]}, executor="serial")
    assert grid["sum"].tolist() == [[13, 14, 15], [23, 24, 25]]
    assert grid.parameter("b").tolist() == [[3, 4, 5], [3, 4, 5]]
    assert repr(grid) == "<Sweep: 2 x 3 points over a, b; quantities sum>"


def test_tables_and_iterables_are_points_too():
    import pandas

    rows = [{"x": 1.0}, {"x": 2.5}]
    expected = vf.sweep(functions.square, rows, executor="serial")
    assert expected["y"].tolist() == [3.5, 10.25]
    structured = np.array([(1.0,), (2.5,)], dtype=[("x", float)])
    for points in (iter(rows), structured, pandas.DataFrame(rows)):
        assert same(vf.sweep(functions.square, points, executor="serial"), expected)


def test_equal_points_are_computed_once():
    table = vf.sweep(functions.square, [{"x": 1}, {"x": 2}, {"x": 1}], executor="serial")
    assert table.counters["computed"] == 2
    assert table["y"].tolist() == [3.5, 7.5, 3.5]


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ({}, "points are empty"),
        ({"x": []}, "points are empty"),
        ([], "points are empty"),
        ({"x": 3.0}, "expected a list of values"),
        ({"x": "abc"}, "expected a list of values"),
        ({"a/b": [1]}, "expected names of arguments"),
        ({3: [1]}, "expected names of arguments"),
        ([{"x": 1}, {"y": 1}], r"names \[.y.\], expected \[.x.\]"),
        ([3.0], "point 0 is 3.0, expected a mapping"),
        (3.0, "expected a mapping of names to lists"),
        ({"x": [object()]}, "an object of type object, expected numbers, texts"),
    ],
)
def test_points_that_cannot_serve_are_refused(points, message):
    with pytest.raises(vf.ArgumentError, match=message):
        vf.sweep(functions.square, points, executor="serial")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"executor": "dask"}, "executor is 'dask', expected None"),
        ({"executor": 4}, "executor is 4, expected None"),
        ({"workers": 0}, "workers is 0, expected a whole number, 1 or more"),
        ({"retry_failed": "no", "executor": "serial"}, "retry_failed is 'no', expected True or False"),
        ({"compiled": 1, "executor": "serial"}, "compiled is 1, expected True or False, or None"),
        ({"time_limit": -1.0, "executor": "serial"}, "time_limit is -1.0, expected a positive number"),
        ({"progress": 3, "executor": "serial"}, "progress is 3, expected True, False, or a function"),
        ({"store": "rows.txt", "executor": "serial"}, "rows.txt.*expected a name that ends in"),
        ({"store": "no/such/folder/rows.h5", "executor": "serial"}, "cannot be written"),
    ],
)
def test_arguments_that_cannot_serve_are_refused(arguments, message):
    with pytest.raises((vf.ArgumentError, vf.OutputError), match=message):
        vf.sweep(functions.square, {"x": [1]}, **arguments)


def test_a_function_that_no_other_process_can_import_is_refused_before_anything_starts():
    with pytest.raises(vf.ArgumentError, match="at the top level of a module"):
        vf.sweep(lambda x: {"y": x}, {"x": [1]})


@pytest.mark.parametrize(
    ("begin", "refused"),
    [("", True), ("if __name__ == '__main__':\n    ", False), ("def main():\n    ", False), ("import logging\n", True)],
)
def test_a_script_without_a_guard_is_refused_before_anything_starts(tmp_path, begin, refused):
    """Each process would import the script and start processes itself; all points failed, with a traceback for each."""
    script = tmp_path / "script.py"
    end = "\nif __name__ == '__main__':\n    main()" if "main()" in begin else ""
    call = "print(vf.sweep(math.sqrt_of, {'x': [1.0, 4.0]}, workers=1, compiled=False)['y'])"
    (tmp_path / "own.py").write_text("def sqrt_of(x): return {'y': x**0.5}\n")
    script.write_text(f"import vofem as vf\nimport own as math\n{begin}{call}{end}\n")
    done = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    assert (done.returncode != 0) == refused
    assert done.stdout.strip() == ("" if refused else "[1. 2.]")
    assert done.stderr.count("if __name__ == '__main__':") == refused


# -- executors ----------------------------------------------------------------------------------------


class Reversed(Executor):
    """An executor that is none of the known ones: it computes at once and knows no number of workers."""

    def submit(self, call, *arguments, **options):
        future = Future()
        future.set_result(call(*arguments, **options))
        return future


def test_every_executor_gives_the_same_bits():
    from distributed import Client, LocalCluster
    from loky import ProcessPoolExecutor as LokyExecutor

    expected = vf.sweep(functions.amplitude, GRID, executor="serial")
    assert expected.failed == ()
    assert expected["closings"].min() > 0
    with ThreadPoolExecutor(2) as threads:
        assert same(vf.sweep(functions.amplitude, GRID, executor=threads), expected)
    assert same(vf.sweep(functions.amplitude, GRID, executor=Reversed()), expected)
    own = vf.sweep(functions.amplitude, GRID, workers=2)
    assert same(own, expected)
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes:
        assert same(vf.sweep(functions.amplitude, GRID, executor=processes), expected)
    # loky imports nothing of this folder by itself, as a worker elsewhere.
    with LokyExecutor(1, env={"PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])}) as loky:
        assert same(vf.sweep(functions.amplitude, GRID, executor=loky), expected)
    # Its processes are those of dask; a thread hears of the sweep in the same way.
    way = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with LocalCluster(**way) as cluster, Client(cluster) as client:
        assert same(vf.sweep(functions.amplitude, GRID, executor=client), expected)


def test_threads_of_linear_algebra_are_limited_in_the_sweep_and_restored_after_it():
    from threadpoolctl import threadpool_info

    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    before = threads()
    table = vf.sweep(lambda x: {"threads": max(threads())}, {"x": [1, 2]}, executor="serial")
    assert table["threads"].tolist() == [1, 1]
    assert threads() == before
    with pytest.raises(RuntimeError, match="inside"), blas_threads(0):
        raise RuntimeError("inside")
    assert threads() == before


def test_scenes_that_a_function_makes_anew_share_what_is_equal():
    """Gaps and frequencies of the load change nothing that modes depend on; another length of the beam does."""
    points = [{"length": 1.0, "gap": gap, "omega": omega} for gap in (0.01, 0.02) for omega in (1.0, 2.0)]
    points += [{"length": 2.0, "gap": 0.01, "omega": 1.0}, {"length": 1.0, "gap": 0.03, "omega": 1.0}]
    table = vf.sweep(functions.beam_at_stop, points, executor="serial", compiled=False)
    assert table["eigensolves"].tolist() == [1, 0, 0, 0, 1, 0]
    assert table["updates"].tolist() == [1, 0, 0, 0, 1, 0]
    # Each point by itself gives the same bits, and outside of sweeps nothing is shared or held.
    alone = [vf.sweep(functions.beam_at_stop, [point], executor="serial", compiled=False) for point in points]
    assert [one["tip"][0] for one in alone] == table["tip"].tolist()
    assert [one["eigensolves"][0] for one in alone] == [1] * 6
    assert functions.beam_at_stop(1.0, 0.01, 1.0)["eigensolves"] == 1


def test_beams_that_are_made_anew_share_their_matrices_only_where_all_numbers_agree():
    from vofem.sharing import sharing_between_scenes

    def matrices(length=1.0, elements=4, EI=1.0, **more):
        return vf.Beam(length, EI, 1.0, elements, **({"supports": {"left": "clamped"}} | more)).matrices()

    assert matrices() is not matrices()
    with sharing_between_scenes():
        first = matrices()
        assert matrices() is first
        others = [{"EI": 2.0}, {"length": 2.0}, {"elements": 5}, {"tension": 1.0}, {"supports": {"left": "pinned"}}]
        others.append({"EI": lambda x: 1.0 + 0.0 * x})
        assert all(matrices(**other) is not first for other in others)
    assert matrices() is not first


def test_small_points_travel_in_batches():
    table = vf.sweep(functions.square, {"x": range(3000)}, executor="serial")
    assert table.counters["batches"] < 40


def test_points_that_take_long_travel_alone():
    sizes = []

    class Counting(Reversed):
        def submit(self, call, task, points):
            sizes.append(len(points))
            return super().submit(call, task, points)

    vf.sweep(lambda x: time.sleep(0.25) or {"y": x}, {"x": range(4)}, executor=Counting())
    assert sizes == [1, 1, 1, 1]


# -- what a point may do ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("kind", "error"),
    [
        ("raise", "ValueError: no such gap"),
        ("exit", "SystemExit: 3"),
        ("number", "TypeError: the function returned 3.0, expected a dict"),
        ("object", "TypeError: the function returned 'y' of type object"),
        (
            "large",
            "TypeError: the function returned 'y' of type int, expected a number or array; this whole number does not "
            "fit into 64 bits",
        ),
        (
            "shape",
            "TypeError: the function returned 'y': number of shape (2,), expected 'y': number of shape () as at first",
        ),
        ("clash", "TypeError: the function returned 'kind', which is the name of a parameter"),
    ],
)
def test_a_failing_point_is_a_row_and_not_the_end(kind, error):
    table = vf.sweep(functions.trouble, {"kind": ["fine", kind, "also fine"]}, executor="serial")
    assert table["y"][[0, 2]].tolist() == [1.0, 1.0]
    assert np.isnan(table["y"][1])
    (one,) = table.failed
    assert (one.index, one.point) == (1, {"kind": kind})
    assert one.error.startswith(error)
    assert any("1 of 3 points failed" in note for note in table.notes)
    if kind == "raise":
        assert "sweep_functions.py" in one.traceback
        assert "worker.py" not in one.traceback
        assert str(one) == "point 1 (kind='raise'): ValueError: no such gap"


def test_a_text_that_no_file_can_hold_fails_its_point_and_not_the_sweep(tmp_path):
    def named(text):
        if text == "\udce9":
            raise FileNotFoundError(text)
        return {"again": text}

    table = vf.sweep(named, {"text": ["a", "a\0b", "\udce9"]}, store=tmp_path / "s.h5", executor="serial")
    assert [one.index for one in table.failed] == [1, 2]
    assert "expected valid Unicode" in table.failed[0].error
    assert vf.load(tmp_path / "s.h5")["again"].tolist() == ["a", "", ""]


def test_a_point_that_returns_nan_has_not_failed():
    table = vf.sweep(functions.trouble, {"kind": ["fine", "nan"]}, executor="serial")
    assert table.failed == ()
    assert np.isnan(table["y"]).tolist() == [False, True]


@pytest.mark.parametrize("kind", ["sleep", "loop"])
def test_a_point_that_hangs_ends_at_its_time_limit(kind):
    slept = len(functions.SLEPT)
    table = vf.sweep(functions.trouble, {"kind": ["fine", kind, "nan"]}, executor="serial", time_limit=0.3)
    assert len(functions.SLEPT) == slept
    assert [one.index for one in table.failed] == [1]
    assert table.failed[0].error == "TimeLimitError: the point took longer than the time limit of 0.3 s"


def test_a_loop_in_a_thread_ends_at_its_time_limit():
    with ThreadPoolExecutor(2) as threads:
        table = vf.sweep(functions.trouble, {"kind": ["fine", "loop"]}, executor=threads, time_limit=0.3)
    assert [one.index for one in table.failed] == [1]


def test_workers_that_die_or_hear_no_signal_are_replaced(monkeypatch):
    monkeypatch.setattr(running, "_GRACE", 3.0)
    kinds = ["fine", "kill", "deaf", "nan"]
    table = vf.sweep(functions.trouble, {"kind": kinds}, workers=2, time_limit=0.5)
    assert [(one.index, one.error.partition(":")[0]) for one in table.failed] == [
        (1, "WorkerError"),
        (2, "TimeLimitError"),
    ]
    assert table.counters["restarts"] >= 3
    assert any("started anew" in note for note in table.notes)


def test_a_broken_executor_of_the_user_ends_the_sweep_with_an_error_and_the_store_keeps_the_rows(tmp_path):
    store = tmp_path / "rows.h5"
    with (
        ProcessPoolExecutor(1, mp_context=get_context("spawn")) as processes,
        pytest.raises(vf.ExecutorError, match="make a new one and run again"),
    ):
        vf.sweep(functions.trouble, {"kind": ["fine", "kill"]}, executor=processes, store=store)
    table = vf.sweep(functions.trouble, {"kind": ["fine", "nan"]}, executor="serial", store=store)
    assert table.counters["stored"] == 1


def test_integers_become_floats_only_where_points_failed():
    def function(x):
        return {"n": 1 // x}

    table = vf.sweep(function, {"x": [1, 2]}, executor="serial")
    assert table["n"].dtype.kind == "i"
    for read in (lambda: table[[]], lambda: table.parameter(np.zeros(2))):
        with pytest.raises(vf.ArgumentError, match=r"no (quantity|parameter) is named"):
            read()
    assert np.isnan(vf.sweep(function, {"x": [1, 0]}, executor="serial")["n"][1])


def test_ctrl_c_gives_what_was_computed():
    def function(x):
        if x == 2:
            raise KeyboardInterrupt
        return {"y": x}

    with pytest.raises(SweepInterrupted) as caught:
        vf.sweep(function, {"x": [0, 1, 2, 3]}, executor="serial")
    assert isinstance(caught.value, KeyboardInterrupt)
    assert caught.value.sweep.counters["computed"] >= 1
    assert caught.value.sweep["y"][0] == 0.0
    assert caught.value.sweep.failed == ()
    # Points that were handed over together with the one that was stopped are lost with it.
    missing = caught.value.sweep.missing
    assert missing[-2:] == (2, 3)
    assert caught.value.sweep.errors()[2] == "not computed: the sweep was stopped before"
    assert f"stopped by Ctrl-C after {4 - len(missing)} of 4 points" in str(caught.value)
    assert f"{len(missing)} not computed" in repr(caught.value.sweep)


def test_ctrl_c_says_how_many_points_are_stored_and_how_to_go_on(tmp_path):
    points, store = {"x": list(range(30))}, tmp_path / "rows.h5"
    function = functools.partial(functions.stops_at, folder=str(tmp_path))
    with pytest.raises(
        SweepInterrupted, match=r"which are kept in .*rows\.h5; the same call computes the rest"
    ) as caught:
        vf.sweep(function, points, executor="serial", store=store)
    assert len(caught.value.sweep.missing) == 30 - caught.value.sweep.counters["computed"]
    assert not any("failed" in note for note in caught.value.sweep.notes)
    (tmp_path / "go").touch()
    table = vf.sweep(function, points, executor="serial", store=store)
    assert table.counters["stored"] == caught.value.sweep.counters["computed"] > 0
    assert table["y"].tolist() == points["x"]


@pytest.mark.parametrize(
    "points", [{"x": [3, 1, 2], "n": [5, 4]}, [{"x": 1, "n": 2}, {"x": 2, "n": 5}, {"x": 1, "n": 3}]]
)
def test_a_store_is_loaded_without_its_function(tmp_path, points):
    store = tmp_path / "rows.h5"
    table = vf.sweep(functions.ratio, points, executor="serial", store=store)
    loaded = vf.load(store)
    assert same(loaded, table)
    assert loaded.points == table.points
    assert [str(one) for one in loaded.failed] == [str(one) for one in table.failed]
    assert loaded.seconds.tolist() == table.seconds.tolist()
    assert loaded.to_xarray().equals(table.to_xarray())
    if table.points.axes is not None:
        plot.sweep_curves(loaded, tmp_path / "curves.png")


def test_a_store_is_loaded_while_it_is_written(tmp_path):
    store = tmp_path / "rows.h5"

    def function(x):
        try:
            return {"rows": len(vf.load(store).points.rows)}
        except vf.StorageError as error:
            return {"rows": 0 if "holds no row yet" in str(error) else -1}

    table = vf.sweep(function, {"x": list(range(5))}, executor="serial", store=store)
    assert table["rows"][0] == 0
    assert table["rows"][-1] > 0
    assert table.failed == ()


def test_progress_is_told_to_a_function():
    told = []
    vf.sweep(functions.trouble, {"kind": ["a", "raise", "b"]}, executor="serial", progress=lambda *k: told.append(k))
    assert told[-1] == (3, 3, 1)


# -- the store ----------------------------------------------------------------------------------------


def test_stored_rows_are_not_computed_again_and_give_the_same_table(tmp_path):
    store = tmp_path / "rows.h5"
    points = {"x": [1, 2, 3]}
    plain = vf.sweep(functions.square, points, executor="serial")
    first = vf.sweep(functions.square, points, executor="serial", store=store)
    again = vf.sweep(functions.square, points, executor="serial", store=store)
    assert (first.counters["computed"], again.counters["computed"]) == (3, 0)
    assert same(first, plain)
    assert same(again, plain)
    wider = vf.sweep(functions.square, {"x": [0, 1, 2, 3, 4]}, executor="serial", store=store)
    assert wider.counters["computed"] == 2
    assert [path.name for path in tmp_path.iterdir()] == ["rows.h5"]


def test_failed_rows_stay_until_they_are_to_be_tried_again(tmp_path):
    store = tmp_path / "rows.h5"
    points = {"kind": ["fine", "raise"]}
    first = vf.sweep(functions.trouble, points, executor="serial", store=store)
    again = vf.sweep(functions.trouble, points, executor="serial", store=store)
    assert again.counters["computed"] == 0
    assert again.failed == first.failed
    assert vf.sweep(functions.trouble, points, executor="serial", store=store, retry_failed=True).counters == {
        "computed": 1, "stored": 1, "batches": 1, "restarts": 0,
    }  # fmt: skip
    # The rows of points that are not asked for stay, failed ones too.
    vf.sweep(functions.trouble, {"kind": ["fine"]}, executor="serial", store=store, retry_failed=True)
    assert [str(one) for one in vf.load(store).failed] == [str(one) for one in first.failed]


def test_a_limit_that_no_timer_reaches_is_none():
    with ThreadPoolExecutor(1) as threads:
        for workers in ("serial", threads):
            table = vf.sweep(functions.square, {"x": [3]}, executor=workers, time_limit=1e12)
            assert table.failed == ()


@pytest.mark.parametrize("odd", ["none", 1j, ["none"]])
def test_a_point_of_another_kind_has_failed_and_leaves_the_column_as_it_is(tmp_path, odd):
    """Texts and complex numbers turn no column of numbers into their kind."""
    for store in (None, tmp_path / "rows.h5", tmp_path / "rows.h5"):
        table = vf.sweep(functions.odd_at_two, {"x": [1, 2, 3], "odd": [odd]}, executor="serial", store=store)
        assert table["y"].dtype == float
        assert table["y"].ravel().tolist() == pytest.approx([0.5, np.nan, 1.5], nan_ok=True)
        (one,) = table.failed
        assert one.point["x"] == 2
        assert "expected 'y': number of shape () as at first" in one.error


def test_mean_and_confidence_over_random_records():
    """Against the closed form, and against how often an interval of 90 % holds the true mean."""

    def function(case, seed):
        if seed == 3 and case == 1:
            raise ValueError("no record")
        return {"y": np.random.default_rng(1000 * case + seed).normal(case, 2.0, size=400), "z": float(seed), "t": "a"}

    table = vf.sweep(function, {"case": [1, 2], "seed": list(range(8))}, executor="serial")
    mean, width = table.mean("y", over="seed"), table.confidence("y", over="seed", level=0.9)
    assert mean.shape == width.shape == (2, 400)
    np.testing.assert_allclose(mean[1], table["y"][1].mean(axis=0), rtol=1e-14)
    # Student's factor for seven degrees of freedom and 90 %.
    np.testing.assert_allclose(width[1], 1.894579 * table["y"][1].std(axis=0, ddof=1) / np.sqrt(8.0), rtol=1e-6)
    inside = np.abs(mean - np.array([[1.0], [2.0]])) <= width
    assert 0.86 < inside.mean() < 0.94
    assert table.mean("z", over="seed").tolist() == [25.0 / 7.0, 3.5]
    assert table.mean("z") == pytest.approx(53.0 / 15.0)
    assert np.isnan(table.confidence("z", over="case")[3])
    for wrong in ({"name": "t"}, {"name": "z", "over": "sed"}, {"name": "w"}):
        with pytest.raises(vf.ArgumentError):
            table.mean(**wrong)
    with pytest.raises(vf.ArgumentError, match=r"level is 95, expected a probability between 0 and 1"):
        table.confidence("z", level=95)


def test_integers_and_floats_are_one_kind():
    table = vf.sweep(lambda x: {"y": x if x > 1 else x / 2}, {"x": [1, 2]}, executor="serial")
    assert table["y"].tolist() == [0.5, 2.0]
    assert table.failed == ()


def test_a_store_opens_in_xarray(tmp_path):
    import xarray

    store = tmp_path / "rows.h5"
    table = vf.sweep(functions.square, {"x": [1, 2, 3]}, executor="serial", store=store)
    with xarray.open_dataset(store, engine="h5netcdf") as data:
        assert data["x"].values.tolist() == [1, 2, 3]
        assert data["y"].values.tolist() == table["y"].tolist()
        assert data["series"].values.tolist() == table["series"].tolist()
        assert data["large"].values.dtype == bool
        assert data["label"].values.tolist() == ["p1", "p2", "p3"]


def test_a_changed_function_starts_anew_and_says_so(tmp_path, monkeypatch):
    store = tmp_path / "rows.h5"
    vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store)
    before = store.read_bytes()
    monkeypatch.setattr(functions, "OFFSET", 2.5)
    table = vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store)
    assert table["y"].tolist() == [4.5]
    assert (
        "rows of a changed function, which were kept as rows.before-1.h5; all points are computed anew"
        in table.notes[0]
    )
    assert (tmp_path / "rows.before-1.h5").read_bytes() == before


def test_a_second_process_is_refused(tmp_path):
    store = tmp_path / "rows.h5"
    first = store_module.SweepFile(store, identity(functions.square)[0])
    code = f"""
import sys
sys.path.insert(0, {str(TESTS)!r})
import sweep_functions, vofem as vf
try:
    vf.sweep(sweep_functions.square, {{"x": [1]}}, executor="serial", store={str(store)!r})
except vf.OutputError as error:
    print(error)
"""
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert f"is being written by another process (process {os.getpid()})" in answer
    first.close()
    vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store)


SCRIPT = """
import functools, sys
sys.path.insert(0, {tests!r})
import sweep_functions, vofem as vf
if __name__ == "__main__":
    function = functools.partial(sweep_functions.slow_square, folder={folder!r}, seconds=0.1)
    table = vf.sweep(function, {{"x": list(range(12))}}, store={store!r}, workers=2, compiled={compiled})
    print(table.counters["restarts"])
"""


def touched(folder):
    return sorted(int(path.name.partition("-")[0]) for path in folder.iterdir())


def started(script, folder, count):
    """Start a sweep in a process of its own and return it once `count` points were begun."""
    process = subprocess.Popen([sys.executable, script], stdout=subprocess.PIPE, text=True)
    for _ in range(600):
        if len(list(folder.iterdir())) >= count:
            return process
        time.sleep(0.05)
    process.kill()
    raise AssertionError("the sweep did not begin")


@pytest.mark.parametrize("victim", ["main", "worker"])
def test_a_sweep_that_was_killed_goes_on_to_the_same_table(tmp_path, victim):
    folder, store = tmp_path / "calls", tmp_path / "rows.h5"
    folder.mkdir()
    script = tmp_path / "study.py"
    way = {"tests": str(TESTS), "folder": str(folder), "store": str(store), "compiled": compiled()}
    script.write_text(SCRIPT.format(**way))
    process = started(script, folder, 8)
    worker = int(max(folder.iterdir(), key=lambda path: path.stat().st_mtime_ns).name.split("-")[1])
    if victim == "worker":
        os.kill(worker, signal.SIGKILL)
        output, _ = process.communicate(timeout=60)
        assert int(output) >= 1
        assert set(touched(folder)) == set(range(12))
    else:
        process.kill()
        process.wait()
        # The workers end with the process that started them.
        for _ in range(100):
            if not Path(f"/proc/{worker}").exists():
                break
            time.sleep(0.1)
        else:
            raise AssertionError("a worker lives on")
    before = len(touched(folder))
    function = functools.partial(functions.slow_square, folder=str(folder), seconds=0.1)
    table = vf.sweep(function, {"x": list(range(12))}, executor="serial", store=store)
    assert same(table, vf.sweep(functools.partial(function, seconds=0.0), {"x": list(range(12))}, executor="serial"))
    if victim == "worker":
        assert table.counters["computed"] == 0
    else:
        assert 1 <= table.counters["stored"] < 12
        assert before >= 8


def test_rows_beside_a_store_belong_to_it_alone(tmp_path):
    """A process that was killed leaves rows beside its store; they go with a store that is removed or is of others."""
    store, beside = tmp_path / "rows.h5", tmp_path / "rows.h5.sqlite"
    left = store_module.SweepFile(store, identity(functions.square, compiled())[0])
    table = vf.sweep(functions.square, {"x": [1, 2]}, executor="serial")
    key = table.points.keys[1]
    left.add([(key, {"x": 2}, store_module.Row({name: np.asarray(table[name][1]) for name in table}, "", "", 0.1))])
    left.close()
    before = {path: path.read_bytes() for path in (store, beside)}
    assert same(vf.load(store), vf.sweep(functions.square, {"x": [2]}, executor="serial"))
    again = vf.sweep(functions.square, {"x": [1, 2]}, executor="serial", store=store)
    assert (again.counters["stored"], same(again, table)) == (1, True)
    assert not beside.exists()
    # Of another function: kept with the store that is renamed.
    for path, content in before.items():
        path.write_bytes(content)
    assert vf.sweep(functions.shifted_square, {"x": [2]}, executor="serial", store=store).counters["stored"] == 0
    assert same(vf.load(tmp_path / "rows.before-1.h5"), vf.sweep(functions.square, {"x": [2]}, executor="serial"))
    assert not beside.exists()
    # Without its store.
    store.unlink()
    beside.write_bytes(before[beside])
    assert vf.sweep(functions.square, {"x": [2]}, executor="serial", store=store).counters["stored"] == 0
    # Damaged: nothing is computed or written.
    store.write_bytes(before[store])
    beside.write_bytes(b"no database at all, but text" * 100)
    with pytest.raises(vf.StorageError, match=r"rows\.h5\.sqlite, which holds the rows that .* remove it to compute"):
        vf.sweep(functions.square, {"x": [2]}, executor="serial", store=store)
    assert store.read_bytes() == before[store]


def test_a_full_disk_ends_with_a_typed_error_and_the_rows_stored_before_it(tmp_path):
    """A limit on the size of files, from the last third of the points on, stands for the disk."""
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    store, limited = tmp_path / "rows.h5", tmp_path / "limited"
    function = functools.partial(functions.square_on_a_full_disk, limited=str(limited))
    try:
        with pytest.raises(vf.OutputError, match=r"rows\.h5 cannot be written"):
            vf.sweep(function, {"x": range(3000)}, executor="serial", store=store)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    table = vf.sweep(function, {"x": range(3000)}, executor="serial", store=store)
    assert 500 < table.counters["stored"] < 3000
    assert same(table, vf.sweep(functions.square, {"x": range(3000)}, executor="serial"))


@pytest.mark.parametrize("content", [b"", b"no HDF5 file at all, but text" * 100])
def test_a_store_that_is_another_file_stays_as_it_is(tmp_path, content):
    store = tmp_path / "rows.h5"
    store.write_bytes(content)
    with pytest.raises(vf.StorageError, match="is no HDF5 file, expected the store of a sweep"):
        vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store)
    assert store.read_bytes() == content


def test_a_saved_run_is_no_store(tmp_path):
    mass = vf.Mass(1.0, 1.0, name="m")
    path = tmp_path / "run.h5"
    vf.simulate(vf.Scene([mass], [vf.PointLoad(mass, 1.0)]), 1.0).save(tmp_path / "run.vtkhdf")
    (tmp_path / "run.vtkhdf").rename(path)
    before = path.read_bytes()
    with pytest.raises(vf.StorageError, match=r"is a saved run, .*expected the store of a sweep"):
        vf.sweep(functions.square, {"x": [1]}, executor="serial", store=path)
    assert path.read_bytes() == before


# -- tables -------------------------------------------------------------------------------------------


def test_xarray_has_the_dimensions_of_the_grid():
    table = vf.sweep(lambda a, b: {"s": a + b, "v": [a, b]}, {"a": [1.0, 2.0], "b": [3, 4, 5]}, executor="serial")
    data = table.to_xarray()
    assert data["s"].dims == ("a", "b")
    assert data["v"].dims == ("a", "b", "v_0")
    assert data["s"].sel(a=2.0, b=4).item() == 6.0


def test_a_dataframe_has_one_row_a_point_and_the_errors():
    table = vf.sweep(functions.trouble, {"kind": ["fine", "raise"]}, executor="serial")
    frame = table.to_dataframe()
    assert frame.columns.tolist() == ["kind", "y", "error"]
    assert frame["error"].tolist() == ["", "ValueError: no such gap"]
    assert table.to_xarray()["y"].dims == ("kind",)


def test_names_that_are_not_there_are_answered_with_the_nearest():
    table = vf.sweep(functions.square, {"x": [1]}, executor="serial")
    with pytest.raises(vf.ArgumentError, match=r"serie.*did you mean 'series'"):
        table["serie"]
    with pytest.raises(vf.ArgumentError, match="no parameter is named 'z'"):
        table.parameter("z")


def test_all_workers_run_kernels_in_the_one_way_that_was_asked_for(tmp_path):
    from vofem.kernels.mode import compiled, kernels

    def function(x):
        return {"compiled": compiled()}

    # Without the argument as the environment has decided.
    for way in (True, False):
        with kernels(compiled=way):
            assert vf.sweep(function, {"x": [1]}, executor="serial")["compiled"].tolist() == [way]
    with ThreadPoolExecutor(1) as threads:
        assert vf.sweep(function, {"x": [1]}, executor=threads, compiled=False)["compiled"].tolist() == [False]
    store = tmp_path / "rows.h5"
    vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store, compiled=False)
    table = vf.sweep(functions.square, {"x": [1]}, executor="serial", store=store, compiled=True)
    assert table.counters["stored"] == 0
    assert "rows of kernels in plain Python" in table.notes[0]


def test_a_quantity_named_error_is_not_lost_in_tables(tmp_path):
    from vofem.io.tables import write_sweep

    table = vf.sweep(lambda x: {"error": 0.1 * x}, {"x": [1, 2]}, executor="serial")
    assert table.to_dataframe().columns.tolist() == ["x", "error", "sweep_error"]
    lines = write_sweep(table, tmp_path / "table.csv").read_text().splitlines()
    assert lines == ["x,error,sweep_error", "1,0.1,", "2,0.2,"]
    table = vf.sweep(lambda x: {"a": np.array([x, 2.0]), "a[0]": 7.0}, {"x": [1.0]}, executor="serial")
    with pytest.raises(vf.ArgumentError, match=r"two columns are named 'a\[0\]'"):
        write_sweep(table, tmp_path / "other.csv")
