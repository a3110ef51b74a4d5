"""Reports: what a study says, as JSON and CSV, as figures, as a rerun recording."""
