"""Rows of the dissertation's table worked out once more, from its equations, by numpy and mpmath alone.

Nothing of gtmbench is imported here (`tests/experiments/test_recomputed_rows.py` holds it to that), and no way of
computing is taken over: series by recursion, Riccati's equation by iteration, determinants by Leverrier, integrals by
quadrature.
"""

import numpy as np
from mpmath import mp

DIGITS = 100


def moments_of_3_55():
    """Return the least three singular values of E[u(k-i) c(k-j)] in example 3.2, i, j = -50..50, least first.

    (3.98) in companion form, u = c - K x with K of the regulator (3.99) of unit weights, c white.
    """
    with mp.workdps(DIGITS):
        poles = [
            mp.mpf(-7) / 10,
            mp.mpf(-6) / 10,
            mp.mpc(0, 0.5),
            mp.mpc(0, -0.5),
            *(mp.mpf(n) / 10 for n in (18, 17, 16)),
        ]
        open_loop = [mp.mpf(1)]
        for pole in poles:
            open_loop = [a - pole * b for a, b in zip([*open_loop, 0], [0, *open_loop], strict=True)]
        open_loop, n = [mp.re(a) for a in open_loop], len(poles)
        A, B = mp.zeros(n), mp.zeros(n, 1)
        for i in range(n):
            A[0, i] = -open_loop[i + 1]
            if i:
                A[i, i - 1] = 1
        B[0] = 1
        P = mp.eye(n)
        for _ in range(450):  # errors fall by the square of the slowest pole of the loop, about 0.7
            K = (B.T * P * A) / (1 + (B.T * P * B)[0])
            P = A.T * P * (A - B * K) + mp.eye(n)
        # c to u: the plant's poles over those of the loop, whose polynomial K adds to in companion form
        closed = [open_loop[0], *(a + k for a, k in zip(open_loop[1:], K, strict=True))]
        heard = []
        for k in range(101):
            above = open_loop[k] if k <= n else mp.mpf(0)
            heard.append(above - sum(closed[i] * heard[k - i] for i in range(1, min(k, n) + 1)))
        matrix = mp.matrix([[heard[j - i] if j >= i else 0 for j in range(101)] for i in range(101)])
        inverse = matrix**-1
        gram = inverse.T * inverse
        space = mp.matrix(np.random.default_rng(7).standard_normal((101, 3)).tolist())
        for _ in range(3):
            space, _ = mp.qr(gram * space, mode="skinny")
        squares = mp.eigsy(space.T * gram * space, eigvals_only=True)
        return sorted(float(1 / mp.sqrt(square)) for square in squares)


def residual_of_4_9(u, y, reach, constant):
    """Return theta, lag -reach first, and c of (4.9) over k = reach..l-reach; `constant`: estimated, records, none."""
    if constant == "records":
        u, y = u - u.mean(axis=0), y - y.mean()
    rows = len(y) - 2 * reach
    phi = np.hstack([u[reach - i : reach - i + rows] for i in range(-reach, reach + 1)])
    if constant == "estimated":
        phi = np.column_stack([phi, np.ones(rows)])
    left, triangle = np.linalg.qr(phi)
    target = y[reach : reach + rows]
    theta = np.linalg.solve(triangle, left.T @ target)
    return theta, float(np.sqrt(np.mean((target - phi @ theta) ** 2)))


def error_of_fig_4_2(identified, other, shown, reach, constant):
    """Return the RMS residual, and the prediction's error over the output's deviation, over `shown` of another record.

    Both records: shape (samples, inputs + 1), the output last.
    """
    u, y = identified[:, :-1], identified[:, -1]
    theta, rms = residual_of_4_9(u, y, reach, constant)
    means = identified.mean(axis=0) if constant == "records" else np.zeros(identified.shape[1])
    centred = other - means
    phi = np.array([[centred[k - i, :-1] for i in range(-reach, reach + 1)] for k in shown]).reshape(len(shown), -1)
    if constant == "estimated":
        phi = np.column_stack([phi, np.ones(len(shown))])
    error = centred[shown, -1] - phi @ theta
    return rms, float(np.sqrt(np.mean(error**2)) / other[:, -1].std())


def operator_5_103():
    """Return numerator and denominator of q1 to q6 under a force on m2, in powers of p: whole numbers, by Leverrier.

    adj(x I + K) = sum of N_j x^(n-1-j), N_0 = I, N_j = (-K) N_(j-1) + c_j I, c_j = trace(K N_(j-1)) / j.
    """
    springs = [(0, 1), (1, 2), (1, 4), (1, 5), (2, 3), (3, 6), (4, 5), (4, 6)]
    K = np.zeros((7, 7), dtype=object)
    for i, j in springs:
        K[[i, j], [i, j]] += 1
        K[[i, j], [j, i]] -= 1
    K = K[1:, 1:]
    identity = np.array([[int(i == j) for j in range(6)] for i in range(6)], dtype=object)
    terms = [identity]
    for j in range(1, 6):
        product = K @ terms[-1]
        terms.append(identity * (sum(np.diag(product)) // j) - product)
    return [in_powers_of_p([int(term[row, 1]) for term in terms]) for row in (5, 0)]


def in_powers_of_p(coefficients):
    """Return a polynomial in x = p^2 as one in p, without leading zeros."""
    first = next(i for i, c in enumerate(coefficients) if c)
    spread = []
    for c in coefficients[first:]:
        spread += [c, 0]
    return spread[:-1]


def operator_5_115(density):
    """Return both parts of T from x_a to x_s of the beam, three of four modes in the outputs; the first number is 1.

    A mode moves by v_i(x_a) f / (p^2 + omega_i^2): the outputs are sums of v_i times that, over the modes' product.
    """
    with mp.workdps(DIGITS):
        E, L, h, w = mp.mpf(200) * 10**9, mp.mpf("0.1"), mp.mpf("0.01"), mp.mpf("0.001")
        x_a, x_s = mp.mpf("0.0833"), mp.mpf("0.0211")
        squares = [(i * mp.pi / L) ** 4 * E * (w * h**3 / 12) / (density * w * h) for i in range(1, 5)]
        parts = []
        for x in (x_s, x_a):
            total = [mp.mpf(0)] * 4
            for i in range(3):
                term = [mp.mpf(1)]
                for j in range(4):
                    if j != i:
                        term = [a + squares[j] * b for a, b in zip([*term, 0], [0, *term], strict=True)]
                weight = mp.sin((i + 1) * mp.pi * x / L) * mp.sin((i + 1) * mp.pi * x_a / L)
                total = [a + weight * b for a, b in zip(total, term, strict=True)]
            parts.append(total)
        return [in_powers_of_p([float(c / parts[0][0]) for c in part]) for part in parts]


def factors_6_29():
    """Return E N_1 N_2 / E N_1^2 of examples 6.5.1 to 6.5.5."""
    with mp.workdps(30):

        def uniform(of):
            return mp.quad(of, [-5, 0, 5]) / 10

        def normal(of):
            return mp.quad(lambda u: of(u) * mp.npdf(u), [-mp.inf, -10, -5, 0, 5, 10, mp.inf])

        square = uniform(lambda u: u**2 * mp.exp(u))
        examples = [
            (uniform, mp.sign, mp.sin),
            (normal, lambda u: u**2 - 1, mp.cos),
            (normal, mp.sinh, lambda u: u**3),
            (uniform, mp.sign, mp.exp),
            (uniform, lambda u: u**2 * mp.exp(u) - square, lambda u: mp.sin(u) + 10),
        ]
        return [float(_product(mean, first, second) / _product(mean, first, first)) for mean, first, second in examples]


def _product(mean, first, second):
    return mean(lambda u: first(u) * second(u))
