"""Parts of benchmarks/accuracy.py: options, runs, records, tables."""
