"""The benchmark: frozen flights, score files of anybody's detector, one judge."""
