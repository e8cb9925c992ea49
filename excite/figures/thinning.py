"""Long records made legible: as much of a signal as can be told apart, and few points of a long line."""

import numpy as np

from excite.types.signal import Signal

MOST_POINTS = 2000  # of a line
MOST_POINTS_FIGURE = 12_000
WINDOW_S = 20.0
FEWEST = 400  # samples that a time window holds at least
MOST_TURNS = 120  # of a drawn line: more fill the picture with ink


def thin(x: np.ndarray, y: np.ndarray, points: int, log: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest sample of each of points // 2 equal bins of x, so that peaks stay.

    x : (N,) increasing; y : (N,), NaN where it is missing; log : bins equal in log x. At most `points` samples.
    """
    points = min(points, MOST_POINTS)
    if len(x) <= points:
        return x, y
    position = np.log(x) if log else x
    edges = np.linspace(position[0], position[-1], points // 2 + 1)[1:-1]
    bins = np.split(np.arange(len(x)), np.unique(np.searchsorted(position, edges)))
    missing = np.isnan(y)
    low, high = np.where(missing, np.inf, y), np.where(missing, -np.inf, y)
    keep = np.unique([i for b in bins if b.size for i in (b[low[b].argmin()], b[high[b].argmax()])])
    return x[keep], y[keep]


def window(count: int, dt: float | None) -> int:
    """Samples of a record of `count` samples that one time axis shows: WINDOW_S, FEWEST at least; all at uneven instants."""
    if dt is None:
        return count
    return min(count, max(round(WINDOW_S / dt), FEWEST))


def legible(signal: Signal, most: int) -> int:
    """Samples to draw of one period, at most `most`: what holds few enough turns; more where that hides half the range."""
    u = signal.u
    longest = min(len(u), signal.period or len(u), most)
    turns = [_turns(column) for column in u[:longest].T]
    shortest = min([longest, *(int(at[MOST_TURNS]) for at in turns if len(at) > MOST_TURNS)])
    for shown in (shortest, longest) if 2 * shortest < longest else (longest,):  # a bit less would only puzzle
        if (np.ptp(u[:shown], axis=0) >= 0.5 * np.ptp(u, axis=0)).all():
            return shown
    return len(u)


def _turns(u: np.ndarray) -> np.ndarray:
    """Samples at which u (N,) begins to rise after it fell, or to fall after it rose."""
    steps = np.diff(u)
    at = np.flatnonzero(steps)
    return at[1:][np.sign(steps[at[1:]]) != np.sign(steps[at[:-1]])]
