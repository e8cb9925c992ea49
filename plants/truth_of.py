"""The truth behind a recording of a simulated plant."""

from excite.arguments import multiple
from excite.errors import ExciteError
from excite.types.recording import Recording
from excite.types.truth import Truth
from plants.registry import load_plant


def truth_of(recording: Recording, view: str | None = None, dt: float | None = None) -> Truth:
    """Return what an ideal identification of a view of a recording would find.

    Parameters
    ----------
    recording : made by one of the simulated plants; its origin says which, with which parameters.
    view : name of the view; None: the recording's default view.
    dt : sampling time that the view was decimated to, s, a whole multiple of the recorded one; None: as recorded.

    Raises
    ------
    ExciteError for a recording that does not say which plant it comes from, and for a dt that is no multiple.
    """
    view, origin = view or recording.default, recording.origin
    if origin.plant is None or view is None:
        raise ExciteError("does not say which plant and view it comes from, so there is no truth; score it without")
    plant = load_plant(origin.plant, preset=origin.preset, parameters=origin.parameters)
    truth = plant.truth(recording, view)
    every = 1 if dt is None else multiple(dt, truth.model.dt)
    if every is None:
        raise ExciteError(f"dt {dt:g} s is no whole multiple of the recorded {truth.model.dt:g} s; decimate the record")
    return truth.lift(every)
