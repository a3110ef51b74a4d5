"""Independent answers for the tests: equations written out lag by lag, nothing of the package's arithmetic."""

from fractions import Fraction

import numpy as np
from scipy import stats

from gtmbench.method.identify import identify
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import Record

MARKOV = np.array([0.5, -1.0, 2.0, 0.3, -0.7])  # lags -2..2
RARE = 1e-5  # a right estimator fails a test of this level once in 100,000 seeds


def record(**channels):
    """Return a record of named channels at 100 Hz."""
    return Record(np.column_stack(list(channels.values())), channels=list(channels), sample_period_s=0.01)


def means(records, names, weights):
    """Return the weighted means over all samples that count."""
    total = sum(w.sum() for w in weights)
    sums = [w[w > 0] @ series.matrix(names)[w > 0] for series, w in zip(records, weights, strict=True)]
    return sum(sums) / total


def lagged(values, r, d):
    """Return rows k = r..l-d of u(k-i): lag i = -d first, channel by channel within."""
    stop = len(values) - d
    return np.hstack([values[r - i : stop - i] for i in range(-d, r + 1)])


def dense(records, inputs, outputs, r, d, weights=None, constant="estimated"):
    """Return regressor, targets and weights of every equation whose samples all count, stacked over the records.

    About the means of the records' samples, or, where a constant is estimated, of the equations.
    """
    weights = [np.ones(len(series)) for series in records] if weights is None else weights
    centre = means(records, [*inputs, *outputs], weights)
    parts = []
    for series, w in zip(records, weights, strict=True):
        if len(series) <= r + d:
            continue
        values = series.matrix([*inputs, *outputs]) - centre
        whole = lagged((w > 0)[:, np.newaxis], r, d).all(axis=1)
        now = slice(r, len(series) - d)
        parts.append((lagged(values[:, : len(inputs)], r, d)[whole], values[now, len(inputs) :][whole], w[now][whole]))
    phi, y, w = (np.concatenate(part) for part in zip(*parts, strict=True))
    if constant == "records":
        return phi, y, w
    return phi - np.average(phi, axis=0, weights=w), y - np.average(y, axis=0, weights=w), w


def as_markov(theta, inputs):
    """Return theta, rows by lag and input, shape (lags, outputs, inputs)."""
    return theta.reshape(-1, inputs, theta.shape[1]).transpose(0, 2, 1)


def least_squares(records, inputs, outputs, r, d, weights=None):
    """Return what LAPACK's SVD finds from the stacked equations and a column of ones, all scaled."""
    phi, y, w = dense(records, inputs, outputs, r, d, weights, "records")
    phi = np.column_stack([phi, np.ones(len(phi))])
    root, scale = np.sqrt(w)[:, np.newaxis], np.sqrt(np.mean(phi**2, axis=0))
    theta = np.linalg.lstsq(phi / scale * root, y * root, rcond=None)[0] / scale[:, np.newaxis]
    return as_markov(theta[:-1], len(inputs))


def exact_least_squares(values, inputs, r, d):
    """Return the Markov parameters of one output, the last column, in whole numbers: nothing is rounded until the end.

    A double is a whole number over a power of two; one common factor of all columns leaves theta as it is.
    """
    pairs = [[float(x).as_integer_ratio() for x in column] for column in values.T]
    common = max(bottom for column in pairs for _, bottom in column)
    exact = [[top * (common // bottom) for top, bottom in column] for column in pairs]
    stop = len(values) - d
    columns = [exact[c][r - i : stop - i] for i in range(-d, r + 1) for c in range(inputs)]
    columns += [[1] * (stop - r), exact[-1][r:stop]]
    gram = [[sum(a * b for a, b in zip(row, other, strict=True)) for other in columns] for row in columns[:-1]]
    return np.array(_solved(gram)[:-1]).reshape(-1, 1, inputs)


def _solved(rows):
    """Return the solution of [A b], A positive definite: Bareiss' elimination, which stays with whole numbers."""
    before, size = 1, len(rows)
    for i in range(size):
        for j in range(size):
            if j != i:
                factor = rows[j][i]
                rows[j] = [(rows[i][i] * a - factor * b) // before for a, b in zip(rows[j], rows[i], strict=True)]
        before = rows[i][i]
    return [float(Fraction(row[-1], row[i])) for i, row in enumerate(rows)]


def siso(records, estimator=None, r=2, d=2, inputs=("u",), outputs=("y",), weights=None, **options):
    """Return an operator, of one input and one output unless told."""
    names = {"inputs": list(inputs), "outputs": list(outputs), "causal_order": r, "noncausal_order": d}
    return identify(records, **names, estimator=estimator, weights=weights, **options)


def operator(r=3, d=2):
    """Return an operator from p, q to r, beta that was made up, not identified."""
    return Transmissibility(
        markov=np.random.default_rng(7).standard_normal((r + d + 1, 2, 2)),
        inputs=("p", "q"),
        outputs=("r", "beta"),
        causal_order=r,
        noncausal_order=d,
        input_means=np.array([1.0, -2.0]),
        output_means=np.array([0.5, 3.0]),
        rank=0,
        samples=0,
        rms_residual=np.zeros(2),
        sample_period_s=0.01,
    )


def distances(operators, output="y", truth=MARKOV):
    """Return the squared errors in the metric of the covariance that each operator states: chi-square variates."""
    return np.array(
        [
            (operator.markov[:, 0, 0] - truth)
            @ np.linalg.solve(operator.covariance(output)[:, 0, :, 0], operator.markov[:, 0, 0] - truth)
            for operator in operators
        ]
    )


def is_chi_square(values, freedom):
    """Tell whether the sum and the distribution of some values fit a chi-square variate."""
    low, high = stats.chi2.ppf([RARE / 2, 1 - RARE / 2], freedom * len(values))
    return low < np.sum(values) < high and stats.kstest(values, stats.chi2(freedom).cdf).pvalue > RARE


def sampled(values, channels):
    """Return columns as a record at 100 Hz."""
    return Record(values, channels=channels, sample_period_s=0.01)
