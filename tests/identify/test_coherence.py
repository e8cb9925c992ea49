"""Outputs by their coherence with what was played."""

import numpy as np
import pytest
from scipy.signal import butter, coherence, lfilter

from excite.errors import ExciteError
from excite.generators.multisine import multisine
from excite.types.experiment import Experiment
from identify.data.coherence import output_coherence, select_outputs, with_outputs

BAND = (3.0, 35.0)


@pytest.fixture(scope="module")
def run():
    """Two references; outputs of the first, of both, of noise alone, and one that never moves."""
    rng = np.random.default_rng(0)
    r, w = rng.standard_normal((2, 40_000, 2))
    y = np.column_stack(
        [r[:, 0] + 0.5 * w[:, 0], lfilter([1], [1, -0.9], r[:, 0] + r[:, 1]) + 0.1 * w[:, 1], w[:, 1], np.ones(40_000)]
    )
    return Experiment(r[:, :1], y, dt=0.01, reference=r, outputs=["tip [m/s2]", "root", "cabin", "dead"])


def test_white_noise_has_the_coherence_of_its_power_ratio(run):
    """gamma^2 = S_signal / (S_signal + S_noise) = 1 / 1.25 at every frequency."""
    found = output_coherence(run, BAND)
    assert found["tip"] == pytest.approx(0.8, abs=0.03)
    assert found["root"] > 0.97
    assert found["cabin"] < 0.2
    assert found["dead"] == 0


def test_one_channel_is_scipy_coherence(run):
    f_hz, gamma = coherence(run.u[:, 0], run.y[:, 0], fs=100, nperseg=5000)
    band = (f_hz >= BAND[0]) & (f_hz <= BAND[1])
    assert output_coherence(run, BAND, "inputs")["tip"] == pytest.approx(gamma[band].mean(), rel=1e-9)


def test_multiple_coherence_sees_both_references(run):
    """One of two equal causes explains half of the power."""
    assert output_coherence(run, BAND, "inputs")["root"] == pytest.approx(0.5, abs=0.05)
    assert list(select_outputs(run, BAND)) == ["tip", "root"]
    assert list(select_outputs(run, BAND, instrument="inputs")) == ["tip"]
    assert list(select_outputs(run, BAND, threshold=0.9)) == ["root"]


def test_frequencies_between_lines_do_not_count():
    """A multisine on every third line: the empty lines, where only noise is, would pull the mean below the threshold."""
    played = multisine(period_s=10.0, dt=0.01, band_hz=BAND, periods=10, amplitude=1.0).u
    noise = 0.05 * np.random.default_rng(0).standard_normal(played.shape)
    run = Experiment(played, lfilter(*butter(2, 0.9), played, axis=0) + noise, dt=0.01, period=1000)
    assert output_coherence(run, BAND)["y1"] > 0.95


def test_what_cannot_be_selected_is_refused(run):
    for band, settings, text in (
        ((40.0, 60.0), {}, "Nyquist frequency"),
        ((3.0001, 3.0002), {}, "no frequency that the record resolves"),
        (BAND, {"threshold": 0.999}, "the best is 'root'"),
        (BAND, {"threshold": 67}, "between 0 and 1"),
        (BAND, {"instrument": "references"}, "did you mean 'reference'"),
    ):
        with pytest.raises(ExciteError, match=text):
            select_outputs(run, band, **settings)
    with pytest.raises(ExciteError, match="has no reference"):
        select_outputs(Experiment(run.u, run.y, dt=0.01), BAND, instrument="reference")
    missing = run.y.copy()
    missing[3, 0] = np.nan
    with pytest.raises(ExciteError, match="gap-free"):
        select_outputs(Experiment(run.u, missing, dt=0.01), BAND)


def test_selected_outputs_make_an_experiment(run):
    chosen = with_outputs(run, ["cabin", "tip"])
    np.testing.assert_array_equal(chosen.y, run.y[:, [2, 0]])
    assert [str(c) for c in chosen.outputs] == ["cabin", "tip [m/s2]"]
    assert chosen.references == run.references
    with pytest.raises(ExciteError, match="did you mean 'tip'"):
        with_outputs(run, ["tipp"])
