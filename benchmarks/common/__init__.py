"""Options, reports and errors that all benchmarks share."""
