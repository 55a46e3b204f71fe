"""Long trials by number: tapes, soak, mutants, files that are not what their names say."""
