"""Frequency responses: lines, what lies between them, and what is refused."""

import pickle

import numpy as np
import pytest
from random_models import state_space

from excite.errors import ExciteError
from excite.models.frequency_response import FrequencyResponse


def test_it_is_exact_at_its_lines_and_straight_between_them():
    model = state_space(np.random.default_rng(0), 4, 2, 3)
    f = np.linspace(0.1, 0.9, 41)
    G = FrequencyResponse(f, model.frf(f), dt=0.5)
    np.testing.assert_array_equal(G.frf(f), model.frf(f))
    halfway = (f[1:] + f[:-1]) / 2
    np.testing.assert_allclose(G.frf(halfway), (G.values[1:] + G.values[:-1]) / 2, rtol=1e-12)
    errors = [
        np.abs(FrequencyResponse(g, model.frf(g)).frf(halfway) - model.frf(halfway)).max()
        for g in (f, np.linspace(0.1, 0.9, 81)[::2], np.linspace(0.1, 0.9, 401))
    ]
    assert errors[2] < errors[0] / 30  # a tenth of the spacing, a hundredth of the error
    assert len(G) == 41 and G.frf(0.3).shape == (1, 3, 2)
    np.testing.assert_array_equal(G.band(0.3, 0.5).values, G.values[(f >= 0.3) & (f <= 0.5)])
    np.testing.assert_array_equal(FrequencyResponse([1.0], [[[2j]]]).frf([1.0, 1.0]), [[[2j]], [[2j]]])


def test_variances_are_a_diagonal_covariance():
    variance = np.arange(1.0, 13.0).reshape(3, 2, 2)
    G = FrequencyResponse([1, 2, 3], np.ones((3, 2, 2)), covariance=variance, coherence=np.full((3, 2), 0.9))
    np.testing.assert_array_equal(G.variance, variance)
    np.testing.assert_array_equal(G.covariance[1], np.diag(variance[1].ravel()))
    full = np.array([[[2, 1j], [-1j, 3]]])
    np.testing.assert_array_equal(FrequencyResponse([1], np.ones((1, 1, 2)), covariance=full).variance, [[[2.0, 3.0]]])
    assert G.band(2, 3).covariance.shape == (2, 4, 4) and G.band(2, 3).coherence.shape == (2, 2)
    again = pickle.loads(pickle.dumps(G))
    assert again.values.tobytes() == G.values.tobytes() and not again.covariance.flags.writeable


G = FrequencyResponse([1.0, 2.0], [[[1.0]], [[2.0]]])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: G.frf([0.5]), "0.5 Hz lies outside the band of this frequency response, 1 to 2 Hz"),
        (lambda: G.frf([1.5, 2.1]), "2.1 Hz lies outside"),
        (lambda: G.frf([np.nan]), "nan Hz lies outside"),
        (lambda: G.band(3, 4), "no frequency from 3 to 4 Hz"),
        (lambda: FrequencyResponse([2.0, 1.0], np.ones((2, 1, 1))), "f_hz: 1 Hz at 1; give increasing frequencies"),
        (lambda: FrequencyResponse([-1.0, 1.0], np.ones((2, 1, 1))), "f_hz: -1 Hz at 0; .* from 0 Hz on"),
        (
            lambda: FrequencyResponse([1.0, 6.0], np.ones((2, 1, 1)), dt=0.1),
            "6 Hz lies above the Nyquist frequency, 5 Hz",
        ),
        (lambda: FrequencyResponse([1.0], np.ones((2, 1, 1))), r"values: shape \(2, 1, 1\), expected \(1, N, N\)"),
        (lambda: FrequencyResponse([], np.ones((0, 1, 1))), "expected \\(frequencies, outputs, inputs\\)"),
        (lambda: FrequencyResponse([1.0], [[[np.nan]]]), "finite values"),
        (lambda: FrequencyResponse([1.0], [[[1.0]]], covariance=[[[-1.0]]]), "covariance: negative variances"),
        (lambda: FrequencyResponse([1.0], [[[1, 2]]], covariance=[[[1, 1j], [1j, 1]]]), "covariance: not Hermitian"),
        (lambda: FrequencyResponse([1.0], [[[1.0]]], coherence=[[1.5]]), "coherence: values outside 0 to 1"),
    ],
)
def test_bad_responses_are_refused_in_words(make, message):
    with pytest.raises(ExciteError, match=message):
        make()
