"""What a reader sees of a run: tables, figures and one self-contained page, all made from a `RunResult`."""
