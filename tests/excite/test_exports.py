"""Files that hardware plays: read back within half a step, certified as played, refused beyond the hardware's limits."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.io import wavfile

from excite.errors import ExciteError
from excite.files import FORMATS, export, load_experiment, load_signal, read_table, save_signal
from excite.files.quantised import quantised
from excite.files.sidecar import sidecar
from excite.generators.prbs import prbs
from excite.generators.sweep import sweep
from excite.persistency.certificate import certify
from excite.types.channel import Channel
from excite.types.experiment import Experiment
from excite.types.recipe import Recipe
from excite.types.signal import Signal

TOP = {
    "wav": 2**23 - 1,
    "c_header": 2**15 - 1,
    "keysight": 2**15 - 1,
    "rigol": 2**15 - 1,
    "rigol_raf": 2**13 - 1,
    "siglent": 2**15 - 1,
}
KNOWN = {name: FORMATS[name] for name in FORMATS}
ONE_CHANNEL = [name for name, given in KNOWN.items() if given.one_channel]
CHANNELS = [Channel("flap", "deg"), Channel('say "hi"; \\n */ #include <x>??/', "m/s²"), Channel("ä [1]", "°")]


def signal(channels=CHANNELS, samples=300, dt=0.02, seed=0):
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, len(channels))) * 10.0 ** rng.integers(-3, 2, len(channels))
    return Signal(
        u, dt, channels, period=samples, recipe=Recipe("noise", {"seed": seed}, {"nested": {"list": [1, None]}})
    )


def ramp():
    return Signal(np.array([0.0, 2.0, -2.0, 1.0, -1.0, 0.0, 0.5, 2.0]), 0.001, [Channel("a", "V")])


def plain_certificate(data, **changes):
    return json.loads(json.dumps(certify(data, **changes).to_dict()))


def same_certificate(a, b):
    assert a.keys() == b.keys()
    for key, value in a.items():
        assert b[key] == (pytest.approx(value, rel=1e-9) if isinstance(value, float) else value), key


# ---- what is read back is what was certified


@pytest.mark.parametrize("fmt", TOP)
def test_read_back_within_half_a_step_with_the_certificate_of_what_is_played(tmp_path, fmt):
    channels = CHANNELS[:1] if fmt in ONE_CHANNEL else CHANNELS
    original = signal(channels)
    path = tmp_path / f"s{FORMATS[fmt].extensions[0]}"
    claimed = certify(original, block_rows=7).to_dict()
    assert export(original, fmt, path, claimed) == (path,)
    table = FORMATS[fmt].read(path)
    played = Signal(table.values[:, 1:], table.meta["dt"], [name[2:] for name in table.names[1:]])
    step = np.abs(original.u).max(0) / TOP[fmt]
    assert (np.abs(played.u - original.u) <= step / 2 * (1 + 1e-9)).all()
    assert (np.abs(played.u).max(0) == np.abs(original.u).max(0)).all()
    assert played.dt == original.dt and tuple(played.channels) == tuple(original.channels)
    same_certificate(table.meta["certificate"], plain_certificate(FORMATS[fmt].quantise(original), block_rows=7))
    assert table.meta["recipe"] == original.recipe.to_dict() and table.meta["period"] == 300
    if read_table(path).names == table.names and fmt != "rigol":  # the format that owns its extension
        again = load_signal(path)
        assert again.u.tobytes() == played.u.tobytes() and again.recipe == original.recipe


@pytest.mark.parametrize("fmt", TOP)
def test_quantising_twice_changes_nothing(fmt):
    once = FORMATS[fmt].quantise(signal())
    assert FORMATS[fmt].quantise(once).u.tobytes() == once.u.tobytes()


samples = arrays(
    float, st.tuples(st.integers(1, 9), st.integers(1, 3)), elements=st.floats(-1e9, 1e9, allow_subnormal=False)
)


@given(u=samples, top=st.sampled_from(sorted({*TOP.values()})))
@settings(max_examples=200, deadline=None)
def test_quantised_is_near_idempotent_and_never_larger(u, top):
    once = quantised(Signal(u, 1.0), top)
    assert quantised(once, top).u.tobytes() == once.u.tobytes()
    assert (np.abs(once.u).max(0) <= np.abs(u).max(0)).all()
    assert (np.abs(once.u - u) <= np.abs(u).max(0) / top / 2 * (1 + 1e-9)).all()
    assert not once.u[u == 0].any()


@pytest.mark.parametrize("fmt", TOP)
def test_without_its_sidecar_a_file_is_still_read(tmp_path, fmt):
    original = signal(CHANNELS[:1])
    path = tmp_path / "s"
    export(original, fmt, path)
    sidecar(path).unlink()
    table = FORMATS[fmt].read(path)
    u = table.group("u")
    full_scale = {"c_header": np.abs(original.u).max(), "keysight": 1.0}.get(fmt, 1.0)
    np.testing.assert_allclose(u, original.u / np.abs(original.u).max() * full_scale, atol=full_scale / TOP[fmt])
    assert table.meta["dt"] == (0.02 if fmt in ("wav", "c_header", "keysight") else None)


@pytest.mark.parametrize("fmt", TOP)
def test_a_changed_file_does_not_count_on_its_sidecar(tmp_path, fmt):
    path = tmp_path / "s"
    export(signal(CHANNELS[:1]), fmt, path)
    other = tmp_path / "other"
    export(signal(CHANNELS[:1], seed=1), fmt, other)
    path.write_bytes(other.read_bytes())
    assert "recipe" not in FORMATS[fmt].read(path).meta


def test_export_certifies_lossless_formats_too(tmp_path):
    export(prbs(order=5, dt=0.1), "csv", tmp_path / "s.csv")
    same_certificate(read_table(tmp_path / "s.csv").meta["certificate"], plain_certificate(prbs(order=5, dt=0.1)))


def test_save_signal_quantises_as_export_does(tmp_path):
    export(signal(), "wav", tmp_path / "a.wav")
    save_signal(signal(), tmp_path / "b.wav", {"order": 999, "block_rows": 20})
    a, b = (read_table(tmp_path / name) for name in ("a.wav", "b.wav"))
    assert a.values.tobytes() == b.values.tobytes() and a.meta == b.meta


# ---- one channel a file


@pytest.mark.parametrize("fmt", ONE_CHANNEL)
def test_several_channels_make_several_files(tmp_path, fmt):
    original = signal()
    paths = export(original, fmt, tmp_path / "out.x")
    assert [path.name for path in paths] == ["out_flap.x", "out_say_hi_n_include_x.x", "out_1.x"]
    assert not (tmp_path / "out.x").exists()
    for i, path in enumerate(paths):
        table = FORMATS[fmt].read(path)
        assert abs(table.group("u")[:, 0] - original.u[:, i]).max() <= np.abs(original.u[:, i]).max() / TOP[fmt]
        assert table.meta["certificate"]["channels"] == [str(CHANNELS[i])]
        together = table.meta["together"]
        assert together["files"] == [path.name for path in paths]
        same_certificate(together["certificate"], plain_certificate(FORMATS[fmt].quantise(original)))


def test_channels_whose_names_would_collide_are_numbered(tmp_path):
    paths = export(signal([Channel("a!"), Channel("A"), Channel("..")]), "siglent", tmp_path / "out.bin")
    assert [path.name for path in paths] == ["out_1.bin", "out_2.bin", "out_3.bin"]


# ---- damaged files


@pytest.mark.parametrize("fmt", [*TOP, "hdf5", "mat", "npz"])
@given(data=st.data())
@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_load_or_are_refused_in_words(tmp_path, fmt, data):
    path = tmp_path / "f"
    if not path.exists():
        export(signal(CHANNELS[:1], samples=20), fmt, path)
        (tmp_path / "whole").write_bytes(path.read_bytes())
    raw = bytearray((tmp_path / "whole").read_bytes())
    for at in data.draw(st.lists(st.integers(0, len(raw) - 1), max_size=4)):
        raw[at] = data.draw(st.integers(0, 255))
    path.write_bytes(raw[: data.draw(st.integers(0, len(raw)) | st.just(len(raw)))])
    try:
        FORMATS[fmt].read(path)
    except ExciteError as error:
        assert str(error).startswith(f"{path}: ")


@pytest.mark.parametrize("fmt", ["rigol", "rigol_raf", "siglent", "wav", "c_header"])
@pytest.mark.parametrize("raw", [b"", b"x", b"\xff" * 15, b"\xff" * 40_000, b"RIFF" + bytes(59)])
def test_files_that_cannot_be_of_the_format(tmp_path, fmt, raw):
    (tmp_path / "f").write_bytes(raw)
    with pytest.raises(ExciteError, match=rf"{re.escape(str(tmp_path))}/f: "):
        FORMATS[fmt].read(tmp_path / "f")


# ---- WAV


def test_wav_is_what_other_programs_read(tmp_path):
    export(signal(dt=1 / 48000), "wav", tmp_path / "s.wav")
    rate, codes = wavfile.read(tmp_path / "s.wav")
    assert rate == 48000 and codes.shape == (300, 3)
    np.testing.assert_allclose(codes / 2**31, signal().u / np.abs(signal().u).max(0), atol=2e-7)


@pytest.mark.parametrize("dt", [0.3, 1 / 44100.5, 3.0, 1e-10])
def test_wav_needs_a_whole_rate(tmp_path, dt):
    with pytest.raises(
        ExciteError, match=r"s\.wav: a WAV file needs a whole number of samples per second, dt = .* Hz; choose"
    ):
        export(signal(dt=dt), "wav", tmp_path / "s.wav")
    assert list(tmp_path.iterdir()) == []


def test_wav_refuses_what_its_header_cannot_count(tmp_path, monkeypatch):
    monkeypatch.setattr("excite.files.wav.MOST_BYTES", 2000)
    with pytest.raises(ExciteError, match="300 samples of 3 channels; a WAV file holds 65535 channels and 2000 bytes"):
        export(signal(), "wav", tmp_path / "s.wav")


@pytest.mark.parametrize("kind", ["uint8", "int16", "int32", "float32", "float64"])
def test_foreign_wav(tmp_path, kind):
    u = np.array([[0.0, -0.5], [0.25, 0.75]])
    scale = {"uint8": 127, "int16": 32767, "int32": 2**31 - 1}.get(kind, 1)
    wavfile.write(tmp_path / "f.wav", 100, (u * scale + (128 if kind == "uint8" else 0)).astype(kind))
    loaded = load_signal(tmp_path / "f.wav")
    np.testing.assert_allclose(loaded.u, u, atol=1.01 / scale if scale > 1 else 1e-7)
    assert loaded.dt == 0.01


def test_a_sidecar_that_does_not_fit_is_named(tmp_path):
    export(signal(), "wav", tmp_path / "s.wav")
    path = sidecar(tmp_path / "s.wav")
    record = json.loads(path.read_text())
    for change in (
        {"full_scale": [1, 2]},
        {"full_scale": ["x"] * 3},
        {"full_scale": [1, 0, 1]},
        {"columns": ["t"]},
        {"dt": "x"},
    ):
        path.write_text(json.dumps(record | change))
        with pytest.raises(ExciteError, match=r"s\.wav: "):
            load_signal(tmp_path / "s.wav")


# ---- C header


def test_c_header_compiles_and_gives_the_same_numbers(tmp_path):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if not compiler:
        pytest.skip("no C compiler")
    export(signal(), "c_header", tmp_path / "my flaps-2.h")
    (tmp_path / "main.c").write_text(
        """#include <stdio.h>
#include "my flaps-2.h"
int main(void) {
    for (int c = 0; c < EXCITE_MY_FLAPS_2_CHANNELS; c++)
        printf("%s|%s\\n", excite_my_flaps_2_names[c], excite_my_flaps_2_units[c]);
    printf("%.17g\\n", excite_my_flaps_2_dt_s);
    for (int k = 0; k < EXCITE_MY_FLAPS_2_SAMPLES; k++)
        for (int c = 0; c < EXCITE_MY_FLAPS_2_CHANNELS; c++)
            printf("%.17g\\n", excite_my_flaps_2_codes[k][c] / 32767.0 * excite_my_flaps_2_full_scale[c]);
    return 0;
}
"""
    )
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wno-unused-variable", "-pedantic", "-Werror", "-trigraphs"]
    subprocess.run([compiler, *flags, "main.c", "-o", "main"], cwd=tmp_path, check=True)
    lines = subprocess.run([tmp_path / "main"], capture_output=True, check=True, encoding="utf-8").stdout.splitlines()
    assert lines[:3] == [f"{c.name}|{c.unit}" for c in CHANNELS]
    assert float(lines[3]) == 0.02
    u = np.array(lines[4:], dtype=float).reshape(-1, 3)
    assert u.tobytes() == load_signal(tmp_path / "my flaps-2.h").u.tobytes()


def test_nothing_in_a_name_gets_out_of_its_string(tmp_path):
    wicked = Channel('"; system("rm -rf /"); // */ ??/', '"\\')
    export(signal([wicked]), "c_header", tmp_path / 'x"; int main(){} #*.h')
    (path,) = (file for file in tmp_path.iterdir() if file.suffix == ".h")
    text = path.read_text(encoding="ascii")
    assert (
        "system(" not in text.replace("system(\\042", "")
        and "*/ ?" not in text
        and "main" not in text.replace("int_main", "")
    )
    sidecar(path).unlink()
    assert load_signal(path).channels == (wicked,)


def test_a_header_whose_codes_were_edited_is_refused(tmp_path):
    path = tmp_path / "s.h"
    export(ramp(), "c_header", path)
    path.write_text(path.read_text().replace("{16384}", "{16383}"))
    with pytest.raises(ExciteError, match=r"s\.h: the codes are not those of its SHA-256"):
        read_table(path)
    (tmp_path / "foreign.h").write_text("int x[2] = {1, 2};")
    with pytest.raises(ExciteError, match="is not a header written by excite"):
        read_table(tmp_path / "foreign.h")


# ---- usage


def test_only_a_signal_is_played(tmp_path):
    data = Experiment(np.ones(9), np.ones(9), dt=0.1)
    with pytest.raises(
        ExciteError, match=r"s\.wav: this format plays a signal, not experiments; load it as a signal first"
    ):
        export(data, "wav", tmp_path / "s.wav")
    export(data, "hdf5", tmp_path / "e.mat")
    assert load_experiment(tmp_path / "e.mat").u.shape == (9, 1)


@pytest.mark.parametrize("fmt", [name for name, given in KNOWN.items() if given.write])
def test_places_that_cannot_be_written(tmp_path, fmt):
    flight = Signal(np.array([[1.0, 40000]] * 20), 0.02, ["roll", "thrust"])
    data = ramp() if FORMATS[fmt].one_channel else flight
    if fmt in ("ardupilot", "px4"):
        dwell = 2 if fmt == "ardupilot" else 0
        data = sweep(dt=0.01, start_hz=1, stop_hz=10, duration_s=10, dwell_cycles=dwell, channels=["roll [deg/s]"])
    for place, reason in (
        (tmp_path, "is a folder"),
        (tmp_path / "missing" / "f", "no folder"),
        ("a\0b", "null character"),
    ):
        with pytest.raises(ExciteError, match=reason):
            export(data, fmt, place)
    assert list(tmp_path.iterdir()) == []


def test_every_format_that_quantises_is_tested():
    tested = {*TOP, "crazyflie", "crazyflie_player", "ardupilot", "px4"}
    assert {name for name, given in KNOWN.items() if given.quantise} == tested
    assert all(given.extensions and Path(f"f{e}").suffix == e for given in KNOWN.values() for e in given.extensions)
