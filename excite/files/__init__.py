"""Data files: one table of formats; the extension chooses, `export` may name one."""

from typing import TYPE_CHECKING

from excite.lazy import face

if TYPE_CHECKING:
    from excite.files.formats import FORMATS, Format
    from excite.files.load import load_experiment, load_recording, load_signal, read_table
    from excite.files.models import load_model, save_model
    from excite.files.save import export, save_experiment, save_recording, save_signal
    from excite.files.table import Table

__all__ = [
    "FORMATS",
    "Format",
    "Table",
    "export",
    "load_experiment",
    "load_model",
    "load_recording",
    "load_signal",
    "read_table",
    "save_experiment",
    "save_model",
    "save_recording",
    "save_signal",
]
__getattr__, __dir__ = face(
    __name__,
    {
        "FORMATS": "excite.files.formats",
        "Format": "excite.files.formats",
        "Table": "excite.files.table",
        "export": "excite.files.save",
        "load_experiment": "excite.files.load",
        "load_model": "excite.files.models",
        "load_recording": "excite.files.load",
        "load_signal": "excite.files.load",
        "read_table": "excite.files.load",
        "save_experiment": "excite.files.save",
        "save_model": "excite.files.models",
        "save_recording": "excite.files.save",
        "save_signal": "excite.files.save",
    },
)
