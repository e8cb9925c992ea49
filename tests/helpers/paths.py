"""Where the checkout lies, and the shared cases and data beside it, which may be missing."""

from pathlib import Path

ROOT = Path(__file__).parents[2]
SHARED = ROOT.parent / "shared"
