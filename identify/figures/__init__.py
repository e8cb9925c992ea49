"""Figures of estimates and comparisons, one file each; `identify.figures.registry` names them."""
