"""Products in parts are the products, whatever their shapes; and none of the parts is large."""

import numpy as np
import pytest

from gtmbench.method import filters as products

SHAPES = [(1, 1, 1), (3, 5, 7), (8, 12, 9000), (9000, 12, 8), (1, 700, 900), (400, 300, 1), (300, 300, 3), (0, 4, 3)]


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_it_is_the_product(shape):
    m, k, n = shape
    random = np.random.default_rng(m + n)
    left, right = random.standard_normal((m, k)), random.standard_normal((k, n))
    np.testing.assert_allclose(products.product(left, right), left @ right, rtol=0, atol=1e-10)
    few = left[:200]
    np.testing.assert_allclose(products.gram(few), few @ few.T, rtol=0, atol=1e-10)


@pytest.mark.parametrize("shape", [(8, 12, 9000), (240, 396, 32), (1, 12, 40_000), (30, 14, 2000)], ids=str)
def test_no_part_is_shared_among_threads(shape, monkeypatch):
    m, k, n = shape
    sizes = []

    def counted(left, right, out):
        sizes.append(left.size * right.shape[1])
        return out

    monkeypatch.setattr(products.np, "matmul", counted)
    products.product(np.ones((m, k)), np.ones((k, n)))
    assert sum(sizes) == m * k * n
    assert max(sizes) <= 4 * 65_536  # GEMM_MULTITHREAD_THRESHOLD times the least that a thread is given
