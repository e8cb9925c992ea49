"""Running a scenario: design, pieces, store, results."""
