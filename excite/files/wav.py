"""WAV: 24-bit PCM, every channel at full scale, the units and the scale in the sidecar.

RIFF/WAVE as in Microsoft and IBM, Multimedia Programming Interface and Data Specifications 1.0 (1991), "WAVE".
24 bits, because every player and data acquisition card takes them; a step is 1.2e-7 of the peak.
"""

import io
import warnings
import wave
from pathlib import Path

import numpy as np

from excite.errors import ExciteError
from excite.files.atomic import readable
from excite.files.formats import Format
from excite.files.quantised import codes_of, decoded_table, quantised
from excite.files.sidecar import written_with_sidecar
from excite.files.table import Table
from excite.types.signal import Signal

TOP = 2**23 - 1
MOST_BYTES = 2**32 - 64  # the RIFF header counts bytes with 32 bits
MOST_CHANNELS = 65535
SCALES = {"int16": 2**15 - 1, "int32": 2**31 - 1, "uint8": 127}


def quantise(signal: Signal) -> Signal:
    """Return what a 24-bit file plays; refuse a rate that is no whole number of Hz, and what the header cannot count."""
    rate = 1 / signal.dt
    if abs(rate - round(rate)) > 1e-9 * rate or not 1 <= round(rate) < 2**32:
        raise ExciteError(
            f"a WAV file needs a whole number of samples per second, dt = {signal.dt:.12g} s gives {rate:.12g} Hz; "
            "choose dt = 1 / (whole number) s"
        )
    samples, channels = signal.u.shape
    if channels > MOST_CHANNELS or 3 * signal.u.size > MOST_BYTES:
        raise ExciteError(
            f"{samples} samples of {channels} channels; a WAV file holds {MOST_CHANNELS} channels and {MOST_BYTES} bytes, "
            "3 per sample: export fewer, or hdf5"
        )
    return quantised(signal, TOP)


def write(table: Table, path: Path) -> None:
    """Write the codes as little-endian 24-bit PCM, and the sidecar."""
    codes, scale = codes_of(table, TOP)
    with written_with_sidecar(path, table, scale) as temporary, wave.open(str(temporary), "wb") as stream:
        stream.setnchannels(codes.shape[1])
        stream.setsampwidth(3)
        stream.setframerate(round(1 / table.meta["dt"]))
        stream.writeframes(codes.astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3].tobytes())


def read(path: Path) -> Table:
    """Return the channels of a WAV file, PCM or float: in units when the sidecar is there, else +-1 is full scale."""
    from scipy.io import wavfile  # here, because only those who open such a file need it

    raw = readable(path).read_bytes()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", wavfile.WavFileWarning)
            rate, samples = wavfile.read(io.BytesIO(raw))
    except Exception as error:  # the parser of this binary format raises almost anything on damaged bytes
        raise ExciteError(f"{path}: cannot be read as a WAV file ({error}); save it again as PCM") from error
    if samples.size == 0 or rate <= 0:
        raise ExciteError(
            f"{path}: {samples.size} samples at {rate} Hz; a WAV file needs at least one sample and a rate"
        )
    samples = samples.reshape(len(samples), -1)
    known = {"dt": 1 / rate}
    if samples.dtype == np.int32 and not (samples & 0xFF).any():  # scipy leaves 24 bits in the upper three bytes
        return decoded_table(samples >> 8, TOP, path, raw, known)
    if samples.dtype == np.uint8:
        samples = samples.astype(np.int16) - 128
        return decoded_table(samples, SCALES["uint8"], path, raw, known)
    if not np.isfinite(samples).all():
        raise ExciteError(f"{path}: a sample is not finite; correct it")
    return decoded_table(samples.astype(np.float64), SCALES.get(str(samples.dtype), 1), path, raw, known)


WAV = Format(
    "sound of 24 bits, for sound cards and loudspeakers",
    (".wav",),
    read,
    write,
    quantise,
    wants={
        "samples": f"a whole number of samples per second; up to {MOST_CHANNELS} channels and 4 GiB; 24 bits, every channel "
        "at full scale"
    },
)
