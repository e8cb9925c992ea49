"""Figures as data: what is drawn, in `excite.figures.figure`; pictures and tables of it, one file per renderer."""
