"""Pictures and clips of a flight, where a graphics library renders offscreen; a clear refusal where none does."""

import numpy as np
import pytest
from quadrotor_flights import PLANT, random_binary

from excite.errors import ExciteError, Unsupported
from excite.types.origin import Origin
from excite.types.recording import Recording
from plants.quadrotor.picture import clip, picture


@pytest.fixture(scope="module")
def flight():
    return PLANT.run(random_binary((10, 10, 10), 1.0), noise=False)


@pytest.fixture(scope="module")
def frame(flight):
    try:
        return picture(flight, 0.0, width=160, height=120)
    except Unsupported as reason:
        pytest.skip(str(reason))


def test_a_picture_shows_the_vehicle_and_its_front(frame):
    assert frame.shape == (120, 160, 3) and frame.dtype == np.uint8
    middle = frame[30:90, 40:120].astype(int)
    red, _, blue = middle.reshape(-1, 3).T
    assert (red > 2 * blue).sum() > 20 and (blue > 2 * red).sum() > 20  # front and rear rotors
    assert frame.std() > 5


def test_a_clip_moves_and_lasts_as_long_as_the_flight(flight, frame, tmp_path):
    from PIL import Image

    clip(flight, tmp_path / "flight.gif", fps=10, width=80, height=60)
    with Image.open(tmp_path / "flight.gif") as film:
        assert film.n_frames == 10 and film.size == (80, 60) and film.info["duration"] == 100
        shown = [np.asarray(film.convert("RGB")) for _ in map(film.seek, (0, 4))]
    assert (shown[0] != shown[1]).any()


def test_what_cannot_be_shown_is_refused(flight, tmp_path, monkeypatch):
    with pytest.raises(ExciteError, match=r"ends in \.gif"):
        clip(flight, tmp_path / "flight.mp4")
    with pytest.raises(ExciteError, match="fps 0"):
        clip(flight, tmp_path / "flight.gif", fps=0)
    with pytest.raises(ExciteError, match="recording is of 'x'"):
        picture(Recording(time_s=[0.0], values=[[0.0]], channels=("x",), origin=Origin("x")))
    monkeypatch.setenv("MUJOCO_GL", "none")
    with pytest.raises(Unsupported, match=r"no graphics library .*none: .* set MUJOCO_GL"):
        picture(flight)
