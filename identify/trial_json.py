"""Trials as strict JSON (null, never NaN), and back."""

from collections.abc import Mapping
from typing import Any

from identify.compare import Failure, Trial
from identify.estimate_json import estimate_from_dict, estimate_to_dict
from identify.score_json import score_from_dict, score_to_dict


def trial_to_dict(trial: Trial) -> dict[str, Any]:
    """Return what the file of a trial holds: the estimate with its score, or the failure with its traceback."""
    estimate, score, failure = trial.estimate, trial.score, trial.failure
    return {
        "label": trial.label,
        "method": trial.method,
        "order": trial.order,
        "data": trial.data,
        "estimate": None
        if estimate is None
        else estimate_to_dict(estimate, None if score is None else score.per_output),
        "score": None if score is None else score_to_dict(score),
        "failure": None if failure is None else {"reason": failure.reason, "traceback": failure.traceback},
    }


def trial_from_dict(data: Mapping[str, Any]) -> Trial:
    """Rebuild a trial."""
    estimate, score, failure = data["estimate"], data["score"], data["failure"]
    return Trial(
        data["label"],
        data["method"],
        data["order"],
        data["data"],
        None if estimate is None else estimate_from_dict(estimate, "estimate"),
        None if score is None else score_from_dict(score),
        None if failure is None else Failure(failure["reason"], failure["traceback"]),
    )
