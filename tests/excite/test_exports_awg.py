"""Arbitrary-waveform generators: the bytes as the makers document them, and the limits of the devices."""

import json
import struct

import numpy as np
import pytest

from excite.errors import ExciteError
from excite.files import export, load_signal, read_table
from excite.files.sidecar import sidecar
from excite.types.channel import Channel
from excite.types.signal import Signal


def ramp():
    return Signal(np.array([0.0, 2.0, -2.0, 1.0, -1.0, 0.0, 0.5, 2.0]), 0.001, [Channel("a", "V")])


def test_rigol_raf_is_14_bits_around_8192(tmp_path):
    export(ramp(), "rigol_raf", tmp_path / "r.raf")
    words = struct.unpack("<8H", (tmp_path / "r.raf").read_bytes())
    assert words == (8192, 16383, 1, 8192 + 4096, 8192 - 4096, 8192, 8192 + 2048, 16383)


def test_rigol_arb_is_16_bits_around_0x8000(tmp_path):
    export(ramp(), "rigol", tmp_path / "r.arb")
    words = struct.unpack("<8H", (tmp_path / "r.arb").read_bytes())
    assert words[:3] == (0x8000, 0xFFFF, 0x0001)
    assert load_signal(tmp_path / "r.arb").u[1, 0] == 2.0  # told from Keysight's text by its content


def test_siglent_is_int16(tmp_path):
    export(ramp(), "siglent", tmp_path / "s.bin")
    assert struct.unpack("<8h", (tmp_path / "s.bin").read_bytes())[:3] == (0, 32767, -32767)
    playback = json.loads((tmp_path / "s.bin.json").read_text())["playback"]
    assert playback == {"sample_rate_hz": 1000, "repetition_hz": 125, "volts_at_full_scale": 2, "units_per_volt": 1}


def test_keysight_text(tmp_path):
    export(ramp(), "keysight", tmp_path / "k.arb")
    assert (tmp_path / "k.arb").read_text().splitlines() == [
        "File Format:1.10",
        "Checksum:0",
        "Channel Count:1",
        "Sample Rate:1000",
        "High Level:2.0",
        "Low Level:-2.0",
        'Data Type:"short"',
        "Data Points:8",
        "Data:",
        "0",
        "32767",
        "-32767",
        "16384",
        "-16384",
        "0",
        "8192",
        "32767",
    ]
    sidecar(tmp_path / "k.arb").unlink()
    np.testing.assert_allclose(load_signal(tmp_path / "k.arb").u, ramp().u, atol=2 / 32767)


def test_a_unit_that_is_no_voltage_plays_one_volt_and_says_what_it_means(tmp_path):
    export(Signal(np.array([0, 30.0] * 4), 0.01, [Channel("flap", "deg")]), "keysight", tmp_path / "k.arb")
    assert "High Level:1.0\nLow Level:-1.0\n" in (tmp_path / "k.arb").read_text()
    record = json.loads((tmp_path / "k.arb.json").read_text())
    assert record["playback"]["volts_at_full_scale"] == 1 and record["playback"]["units_per_volt"] == 30


def test_a_foreign_keysight_file_with_offset_and_float_data(tmp_path):
    head = "Copyright:Agilent Technologies, 2010\r\nFile Format:1.10\r\nChannel Count:1\r\nColumn Char:TAB\r\nSample Rate:50\r\n"
    path = tmp_path / "k.arb"
    path.write_text(
        head + 'High Level:3\r\nLow Level:1\r\nData Type:"short"\r\nData Points:3\r\nData:\r\n-32767\r\n0\r\n32767\r\n'
    )
    loaded = load_signal(path)
    np.testing.assert_allclose(loaded.u[:, 0], [1, 2, 3], rtol=1e-12)
    assert loaded.dt == 0.02 and loaded.channels == (Channel("u1", "V"),)
    path.write_text(
        head + 'High Level:2\r\nLow Level:-2\r\nData Type:"float"\r\nData Points:2\r\nData:\r\n-1.0\r\n0.5\r\n'
    )
    np.testing.assert_allclose(load_signal(path).u[:, 0], [-2, 1], rtol=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "Sample Rate:1\nHigh Level:1\nLow Level:-1\nData Points:3\nData:\n1\n2\n",
        "Sample Rate:1\nHigh Level:1\nLow Level:-1\nData Points:1\nData:\nx\n",
        "Sample Rate:1\nHigh Level:1\nData Points:1\nData:\n1\n",
        "Data:\n1\n2\n",
        "Sample Rate:0\nHigh Level:1\nLow Level:-1\nData Points:1\nData:\n1\n",
        "Sample Rate:1\nHigh Level:-1\nLow Level:1\nData Points:1\nData:\n1\n",
        "Sample Rate:1\nHigh Level:1\nLow Level:-1\nData Points:1\nData:\n99999\n",
        "Sample Rate:1\nHigh Level:nan\nLow Level:-1\nData Points:1\nData:\n1\n",
    ],
)
def test_damaged_keysight_files(tmp_path, text):
    (tmp_path / "k.arb").write_text("File Format:1.10\n" + text)
    with pytest.raises(ExciteError, match=r"k\.arb: "):
        read_table(tmp_path / "k.arb")


@pytest.mark.parametrize(
    ("fmt", "least", "most"),
    [("keysight", 8, 1_000_000), ("rigol", 8, 16384), ("rigol_raf", 8, 16384), ("siglent", 2, 16384)],
)
def test_lengths_beyond_the_generator_are_refused_with_numbers(tmp_path, fmt, least, most):
    for count in (least - 1, most + 1):
        with pytest.raises(ExciteError, match=rf"out: {count} samples, but .* holds {least} to {most} points; export"):
            export(Signal(np.ones(count), 0.1), fmt, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []
    for count in (least, min(most, 16384)):
        export(Signal(np.linspace(-1, 1, count), 0.1), fmt, tmp_path / "out")


def test_levels_and_rates_beyond_the_generator_are_refused(tmp_path):
    for unit, peak in (("V", 10.5), ("", 11), ("mV", 10_500)):
        with pytest.raises(ExciteError, match=r"peak 1[01][.\d]* V, but .* plays at most 10 V"):
            export(Signal(np.full(8, peak), 0.1, [Channel("a", unit)]), "keysight", tmp_path / "out.arb")
    with pytest.raises(ExciteError, match=r"1e\+09 samples/s, but .* plays 2.5e\+08"):
        export(Signal(np.ones(8), 1e-9), "keysight", tmp_path / "out.arb")
