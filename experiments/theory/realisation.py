"""Systems from their Markov parameters, section 3.8: block-Hankel matrices, the eigensystem realisation algorithm."""

from __future__ import annotations

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray
from theory.annuli import on_circle
from theory.laurent import reflected
from theory.state_space import StateSpace


def markov_parameters(given: ArrayLike) -> FloatArray:
    """Return H_0, H_1, ... as an array of shape (count, outputs, inputs); a vector has one input and one output.

    Raises
    ------
    InputError
        Where there are none, or one isn't finite.
    """
    markov = np.asarray(given, dtype=np.float64)
    markov = markov[:, np.newaxis, np.newaxis] if markov.ndim == 1 else markov
    if markov.ndim != 3 or not markov.size or not np.all(np.isfinite(markov)):
        raise InputError(
            f"Markov parameters have shape {np.shape(given)}; give finite ones of shape (count, outputs, inputs)"
        )
    return markov


def block_hankel(markov: ArrayLike) -> FloatArray:
    """Return the matrix of the blocks H_(i+j-1), i, j = 1..n, equation (3.2), from H_0..H_(2n-1).

    H_0 isn't in it, nor is an odd last one. (3.101) is this of the stable part. So is (3.103) of the reflected unstable
    part, once the order of its blocks is turned about: printed, it begins with the last of them.

    Examples
    --------
    >>> block_hankel([0.0, 1.0, 0.5, 0.25])
    array([[1.  , 0.5 ],
           [0.5 , 0.25]])
    """
    blocks = markov_parameters(markov)
    n, outputs, inputs = len(blocks) // 2, *blocks.shape[1:]
    places = np.add.outer(np.arange(n), np.arange(n)) + 1
    return np.asarray(blocks[places].transpose(0, 2, 1, 3).reshape(n * outputs, n * inputs))


def hankel_singular_values(markov: ArrayLike) -> FloatArray:
    """Return the singular values of the matrix (3.2), falling; as many as the order aren't 0 where nothing is noisy.

    >>> hankel_singular_values([0.0, 1.0, 0.5, 0.25]).round(9)
    array([1.25, 0.  ])
    """
    return np.asarray(np.linalg.svd(block_hankel(markov), compute_uv=False))


def era(markov: ArrayLike, order: int) -> StateSpace:
    """Realise H_0..H_(2n-1) by the eigensystem realisation algorithm: D = H_0, C A^(i-1) B near H_i.

    Of the Hankel matrix (3.2) all but the last block column is factored, P S Q', `order` singular values are kept, and
    all but the first is what A moves it to: A = S^-1/2 P' (H_(i+j)) Q S^-1/2, B the first columns of S^1/2 Q', C the
    first rows of P S^1/2. Exact parameters of a system of that order, n greater than it, give the system exactly.

    Raises
    ------
    InputError
        Where the parameters are too few for the order, or their matrix has a lower rank.

    Examples
    --------
    >>> era([2.0, 1.0, 0.5, 0.25], order=1).poles.real.round(9), era([2.0, 1.0, 0.5, 0.25], order=1).D
    (array([0.5]), array([[2.]]))
    """
    blocks = markov_parameters(markov)
    outputs, inputs = blocks.shape[1:]
    hankel = block_hankel(blocks)
    before, after = hankel[:, :-inputs], hankel[:, inputs:]
    if whole("order", order) > min(before.shape):
        raise InputError(
            f"{len(blocks)} Markov parameters bear order {min(before.shape)} at most, not {order}; give H_0..H_k "
            f"with k at least {2 * -(-order // min(outputs, inputs)) + 1}"
        )
    if order == 0:
        return StateSpace(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), blocks[0])
    left, singular, right = np.linalg.svd(before, full_matrices=False)
    rank = int(np.sum(singular > max(before.shape) * np.finfo(float).eps * singular[0]))
    if order > rank:
        raise InputError(
            f"the Hankel matrix of these Markov parameters has rank {rank}, too low for order {order}; ask for {rank} "
            "at most"
        )
    root = np.sqrt(singular[:order])
    P, Q = left[:, :order], right[:order].T
    return StateSpace(
        A=P.T @ after @ Q / np.outer(root, root), B=(Q * root)[:inputs].T, C=(P * root)[:outputs], D=blocks[0]
    )


def realise(coefficients: ArrayLike, *, noncausal_order: int, stable_order: int, unstable_order: int) -> StateSpace:
    """Return G = G_s + G_u + D, (3.18), from its Laurent coefficients L_i, i = -d..r, about the unit circle.

    ERA gives G_s from L_1, L_2, ..., and G_u(1/z) from L_0, ``L_-1``, ..., which Proposition 2 turns about; what L_0
    has beyond H_u,0 is D, equation (3.23).

    Parameters
    ----------
    coefficients : array_like, shape (d + 1 + r, outputs, inputs)
        ``L_-d`` first, as `LaurentSeries.coefficients` and `Transmissibility.markov` have them. The more of them are
        noise only, the worse: cut to 2 n - 1 on either side.
    noncausal_order : int
        d.
    stable_order, unstable_order : int
        States of G_s and of G_u; 0 where there is no such part.

    Raises
    ------
    InputError
        As `era`; where the parts found don't have their poles on either side of the unit circle; where G is improper.

    Examples
    --------
    >>> from theory.laurent import laurent
    >>> G = StateSpace([[0.5, 1.0], [0.0, 2.0]], [[0.0], [1.0]], [[1.0, 0.0]], [[3.0]])
    >>> series = laurent(G, causal_order=5, noncausal_order=5)
    >>> again = realise(series.coefficients, noncausal_order=5, stable_order=1, unstable_order=1)
    >>> again.poles.real.round(9), again.D.round(9)
    (array([0.5, 2. ]), array([[3.]]))
    """
    blocks = markov_parameters(coefficients)
    centre = whole("noncausal_order", noncausal_order, 0, len(blocks) - 1)
    stable = _part("causal", blocks[centre:], stable_order)
    turned = _part("noncausal", blocks[centre::-1], unstable_order)
    if on_circle(turned, 0.0):
        raise InputError(
            "the noncausal coefficients end, as those of z or z^2 do: G is improper, and no (A, B, C, D) realises it"
        )
    unstable = reflected(turned)
    return StateSpace(
        A=scipy.linalg.block_diag(stable.A, unstable.A),
        B=np.vstack([stable.B, unstable.B]),
        C=np.hstack([stable.C, unstable.C]),
        D=unstable.D,
    )


def _part(side: str, markov: FloatArray, order: int) -> StateSpace:
    part = era(markov, order)
    growth = float(np.abs(part.poles).max(initial=0.0))
    if growth >= 1.0:
        raise InputError(
            f"the {side} coefficients, with order {order}, grow by {growth:.4g} a lag, so they aren't those of a "
            "series about the unit circle; lower that order"
        )
    return part
