"""Errors that reach the user: each message names the place, the value and the remedy."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches

LONGEST = 600  # characters of an error in words


class ExciteError(Exception):
    """Bad input or usage; the command line prints the message and exits with `exit_code`."""

    exit_code = 2


class DesignRefused(ExciteError):
    """A design is unsafe for the plant or cannot excite what is asked of it."""

    exit_code = 3


class SimulationStopped(ExciteError):
    """A simulated run left its safe region (tilt, ground contact, divergence) and was stopped."""


class Unsupported(ExciteError):
    """A method cannot take the data it was given; comparisons print the message as the reason."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the remedy for a misspelt name: the nearest known one, or the list of them."""
    known = sorted(known)
    near = get_close_matches(name, known, n=1, cutoff=0.6)
    return f"did you mean '{near[0]}'?" if near else f"known: {', '.join(known)}"


def in_words(error: BaseException) -> str:
    """Return an error of whatever kind as one line: its message where it is ours, else its type and message.

    Messages of many lines become one line without control characters, and the longest are cut: the traceback has the
    whole.
    """
    try:
        text = " ".join(str(error).split())
        text = "".join(c if c.isprintable() else "?" for c in text)
    except Exception:  # an error of another package whose message cannot be made
        text = ""
    if not isinstance(error, ExciteError):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 1]}…"


@contextmanager
def placed(place: str) -> Iterator[None]:
    """Put the place (a file, a key path) before the message of an error raised inside."""
    try:
        yield
    except ExciteError as error:
        raise type(error)(f"{place}: {error}") from error
