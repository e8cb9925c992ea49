"""The design loop: proposals play as they are, keep their promises, and start from a model as well."""

import numpy as np
import pytest

from excite.errors import DesignRefused, ExciteError
from excite.generators import GENERATORS
from excite.models.frequency_response import FrequencyResponse
from excite.models.state_space import StateSpaceModel
from excite.persistency.certificate import certify
from excite.proposal.knowledge import Knowledge, knowledge_of
from excite.proposal.proposal import KINDS, propose

KNOWN = Knowledge(bandwidth_hz=5.0, settling_s=2.0, limit=3.0, noise=0.3, gain=0.5)


def play(proposal):
    options = {"time_limit_s": 0.5} if proposal.kind == "multisine" else {}
    return GENERATORS[proposal.kind](**proposal.parameters, **options)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("channels", [1, 3])
def test_proposals_play_within_the_limit_and_reach_the_band(kind, channels):
    proposal = propose(kind, KNOWN, channels=channels)
    signal = play(proposal)
    assert signal.u.shape[1] == channels and np.abs(signal.u).max() <= 3.0 * (1 + 1e-9)
    spectrum, f = np.abs(np.fft.rfft(signal.u, axis=0)) ** 2, np.fft.rfftfreq(len(signal.u), signal.dt)
    inside = (f >= 0.5) & (f <= 5.0)
    assert (spectrum[inside].sum(0) > 0.3 * spectrum[1:].sum(0)).all()
    assert set(proposal.parameters) - set(proposal.reasons) <= {"channels", "form"}
    assert certify(signal, block_rows=10).reached


def test_a_prbs_stays_apart_for_the_settling_time():
    signal = play(propose("prbs", KNOWN, channels=3))
    assert signal.recipe["usable_response_s"] >= KNOWN.settling_s


def test_noise_asks_for_periods_and_says_when_they_are_too_many():
    loud = Knowledge(5.0, 2.0, 1.0, noise=0.5)
    assert propose("prbs", loud).parameters["periods"] == 25
    assert "would be needed" in propose("prbs", Knowledge(5.0, 2.0, 1.0, noise=50.0)).warnings[0]
    assert propose("prbs", Knowledge(5.0, 2.0, 1.0)).parameters["periods"] == 2


def test_sampling_is_checked_against_aliasing():
    assert 1 / propose("prbs", KNOWN).parameters["dt"] >= 50
    with pytest.raises(DesignRefused, match="Nyquist frequency at 5 Hz, not above the bandwidth 5 Hz"):
        propose("sweep", KNOWN, dt=0.1)
    assert "anti-alias filter" in propose("sweep", KNOWN, dt=0.05).warnings[0]


def test_the_next_design_starts_from_a_model():
    A = np.array([[0.95, 0.25, 0], [-0.25, 0.95, 0], [0, 0, 0.9]])
    model = StateSpaceModel(
        A, [[0], [1], [1]], [[1, 0, 0.2]], [[0]], 0.02, K=[[0.1], [0], [0]], innovation_cov=[[0.01]]
    )
    known = knowledge_of(model, limit=2.0)
    resonance = np.angle(0.95 + 0.25j) / (2 * np.pi * 0.02)
    assert known.bandwidth_hz > resonance and known.noise == pytest.approx(0.1)
    slowest = min(-np.log(np.abs(model.poles()))) / 0.02
    assert known.settling_s == pytest.approx(4 / slowest)
    f, amplitude = np.array(known.spectrum).T
    assert amplitude.max() == pytest.approx(1) and amplitude.min() >= 0.1
    assert amplitude[np.argmin(np.abs(f - resonance))] < amplitude[-1]  # loud where the plant is quiet
    signal = play(propose("multisine", known))
    lines = np.array(signal.recipe["decided"]["line_amplitudes"][0])
    assert lines.max() / lines.min() > 2


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Knowledge(-1, 1, 1), r"Knowledge\.bandwidth_hz: -1"),
        (lambda: Knowledge(1, 1, 1, noise=float("nan")), r"Knowledge\.noise: nan"),
        (lambda: propose("prb", KNOWN), "kind 'prb'; did you mean 'prbs'"),
        (lambda: propose("sweep", Knowledge(0.1, 2.0, 1.0)), "leave no band to sweep"),
        (lambda: knowledge_of(StateSpaceModel([[1]], [[1]], [[1]], [[0]], 1.0), 1.0), "only integrators"),
        (lambda: knowledge_of(FrequencyResponse([1.0], [[[1.0]]], 0.1), 1.0), "a FrequencyResponse does not tell"),
    ],
)
def test_bad_knowledge_is_refused(make, message):
    with pytest.raises(ExciteError, match=message):
        make()
