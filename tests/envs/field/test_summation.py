"""The vector instructions do what numpy's complex arithmetic does, and touch nothing else."""

import numba
import numpy as np
import pytest

from usbench.envs.field.summation import SAMPLES, weighted_sum


@pytest.mark.parametrize("add", [False, True])
@pytest.mark.parametrize("n_terms", range(5))
def test_is_the_weighted_sum(n_terms, add):
    weighted = weighted_sum(n_terms, add)

    @numba.njit
    def compiled(target, first, n, source, firsts, weights):
        weighted(target, first, n, source, firsts, weights)

    generator = np.random.default_rng(n_terms)
    parts = generator.standard_normal((2, 2, 64))
    target, source = (parts[0] + 1j * parts[1]).astype(np.complex64)
    weights = generator.standard_normal(2 * n_terms).astype(np.float32)
    firsts = tuple(3 * k + 1 for k in range(n_terms))
    first, n = 5, 3 * SAMPLES
    expected = target.copy()
    expected[first : first + n] = expected[first : first + n] if add else 0
    for k, start in enumerate(firsts):
        weight = weights[2 * k] + 1j * weights[2 * k + 1]
        expected[first : first + n] += weight * source[start : start + n]
    compiled(target, first, n, source, firsts, tuple(weights))
    np.testing.assert_allclose(target, expected, rtol=1e-5, atol=1e-6)
    outside = np.r_[0:first, first + n : len(target)]
    assert (target[outside] == expected[outside]).all()
