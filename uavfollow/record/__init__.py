"""What a run leaves behind: rows, plots, a report, written whole or not at all."""
