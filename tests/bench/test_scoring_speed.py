"""Scoring against fitting: an arx model of 20 lags in three channels, on a record of the length of the main job's."""

import numpy as np
import pytest
from random_models import polynomial

from excite.models.polynomial import PolynomialModel
from excite.types.experiment import Experiment
from identify.fit import fit
from identify.score import predictions

pytestmark = pytest.mark.bench
SAMPLES = 63_750


def test_predictions_of_a_long_arx_cost_a_few_fits(fastest):
    rng = np.random.default_rng(0)
    true = polynomial(rng, 3, 3, na=20, nb=20)
    true = PolynomialModel(true.a, true.b, 0.002)
    u = rng.standard_normal((SAMPLES, 3))
    data = Experiment(u, true.simulate(u) + rng.standard_normal((SAMPLES, 3)), dt=0.002)
    fitting, estimate = fastest(5, lambda: fit(data, "arx", 20))
    ours, found = fastest(5, lambda: predictions(estimate.model, data, (50,)))
    theirs, expected = fastest(2, lambda: predictions(estimate.model.to_state_space(), data, (50,)))
    print(f"\nfit {fitting:.4f} s, simulation and predictions {ours:.4f} s, through 60 states {theirs:.4f} s")
    for name, yhat in expected.items():
        np.testing.assert_allclose(found[name], yhat, atol=1e-8 * np.abs(yhat).max())
    assert ours < 4 * fitting and 2 * ours < theirs
