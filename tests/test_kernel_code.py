"""Kernels give as machine code what they give in Python: loops, elements, rows, slices and complex numbers."""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vofem.kernels.jit import jit

WHOLE = st.integers(-7, 7)


@jit
def _loops(start, stop, step, numbers):
    """Write what loops of several kinds have counted."""
    last, sums = -100, 0
    for k in range(stop):
        last = k
        if k == 2:
            continue
        for i in range(k, stop):
            if i > 4:
                break
            sums += 10 * k + i
    numbers[0], numbers[1] = last, sums
    total = 0
    for k in range(start, stop, step):
        total = 3 * total + k
    numbers[2] = total
    total = 0
    for k in range(stop, start, -1):
        total = 3 * total + k
    else:
        total += 1
    numbers[3] = total
    # One iterator for two loops.
    both = iter(range(start, stop))
    for k in both:
        numbers[4] = k
        break
    total = 0
    for k in both:
        total = 2 * total + k
    numbers[5] = total
    several = range(start, stop)
    numbers[6] = len(several)
    for k, i in enumerate(several):
        total += k * i
    for k, i in zip(range(5), several):  # noqa: B905 - numba knows no `strict`
        total -= k - i
    numbers[7] = total


@given(WHOLE, WHOLE, WHOLE.filter(bool))
@example(0, 0, 1)
@example(-3, 7, 2)
def test_loops_over_ranges(start, stop, step):
    compiled, plain = np.zeros(8, dtype=np.int64), np.zeros(8, dtype=np.int64)
    _loops(start, stop, step, compiled)
    _loops.py_func(start, stop, step, plain)
    assert compiled.tolist() == plain.tolist()


def test_a_range_without_a_step_is_refused():
    with pytest.raises(ValueError, match="must not be zero"):
        _loops(0, 3, 0, np.zeros(8, dtype=np.int64))


class Bundle(NamedTuple):
    values: np.ndarray
    cube: np.ndarray


@jit
def _parts(bundle, i, j, k, out):
    """Write elements, rows and slices of arrays, and sizes."""
    cube, values = bundle.cube, bundle.values
    row = cube[i]
    line = cube[i, j]
    out[0], out[1], out[2] = row[j, k], line[k], cube[i, j, k]
    out[3], out[4], out[5] = row.size, line.shape[0], row.shape[1]
    place = 6
    for part in (values[i:], values[:j], values[i:j], values[:], line[i:j], row[k][: values.size]):
        out[place] = part.size
        for one in part:
            out[place + 1] = 2.0 * out[place + 1] + one
        place += 2
    inner = row[1:3]
    out[place], out[place + 1] = inner.shape[0], inner[0, k]
    into = cube[0, 1]
    into[i] = 99.0
    cube[1, 2][j:] = 7.0
    values[k] += 1.0


@given(st.integers(-3, 2), st.integers(-3, 2), st.integers(-3, 2))
def test_elements_rows_and_slices(i, j, k):
    outs, bundles = [], []
    for function in (_parts, _parts.py_func):
        bundle, out = Bundle(np.arange(3.0) + 1.0, np.arange(27.0).reshape(3, 3, 3)), np.zeros(20)
        function(bundle, i, j, k, out)
        outs.append(out.tolist())
        bundles.append(bundle)
    assert outs[0] == outs[1]
    np.testing.assert_array_equal(bundles[0].cube, bundles[1].cube)
    np.testing.assert_array_equal(bundles[0].values, bundles[1].values)


@jit
def _allocates(matrix, count):
    """Return rows and slices of a new array, which outlive it here."""
    new = np.empty((3, 4))
    for i in range(3):
        for j in range(4):
            new[i, j] = matrix[i, j] + 1.0
    row = new[1]
    part = row[:count]
    new = np.zeros((3, 4))
    return row, part, new[2, 1:]


def test_rows_keep_the_arrays_that_they_belong_to():
    matrix = np.arange(12.0).reshape(3, 4)
    kept = [_allocates(matrix, 2) for _ in range(50)]
    for row, part, rest in kept:
        assert row.tolist() == [5.0, 6.0, 7.0, 8.0]
        assert part.tolist() == [5.0, 6.0]
        assert rest.tolist() == [0.0, 0.0, 0.0]


@jit
def _complex(a, b, x, out):
    out[0], out[1], out[2] = a * b, a * x, x * b
    out[3] = a
    out[3] *= b
    out[4] = complex(b.imag, a.real)
    out[5] = a * b * a


@jit
def _quotients(a, b):
    return a / b, 1.0 / b, b.real / a


NUMBERS = st.complex_numbers(max_magnitude=1e60, allow_nan=False, allow_infinity=False)


@given(NUMBERS, NUMBERS, st.floats(-1e60, 1e60))
@example(1 + 1j, 0j, 1.0)
@example(2 - 1j, 3j, 0.0)
def test_complex_numbers(a, b, x):
    compiled, plain = np.zeros(6, dtype=complex), np.zeros(6, dtype=complex)
    _complex(a, b, x, compiled)
    _complex.py_func(a, b, complex(x), plain)
    assert compiled.tobytes() == plain.tobytes() or np.array_equal(compiled, plain)
    if a == 0.0 or b == 0.0:
        with pytest.raises(ZeroDivisionError):
            _quotients(a, b)
        return
    for own, python in zip(_quotients(a, b), (a / b, (1.0 + 0j) / b, complex(b.real) / a), strict=True):
        assert own == python or (cmath.isnan(own) and cmath.isnan(python))


def test_a_part_that_is_not_a_number_stays_visible():
    assert all(math.isnan(part.real) for part in _quotients(complex(math.nan, 1.0), complex(1.0, math.nan)))


@jit
def _squares(x, n):
    return x**2, n**2, x**3, n**-1.0 if n else 0.0, 2.0**x


@given(st.floats(-1e3, 1e3), st.integers(-1000, 1000))
def test_powers(x, n):
    found = _squares(x, n)
    assert found[:2] == (x * x, n * n)
    assert found[2:] == pytest.approx((x**3, n**-1.0 if n else 0.0, 2.0**x), rel=1e-15)


@jit
def _of_constant(values, count):
    """Depends on a number that callers give as a constant."""
    return values[count] + count


@jit
def _calls_with_constants(values):
    return _of_constant(values, 0) + _of_constant(values, 1) + _of_constant(values, 2)


def test_constants_make_no_further_versions():
    assert _calls_with_constants(np.arange(3.0)) == 6.0
    assert len(_of_constant.callee.signatures) == 1
