"""Parts of the timing benchmarks."""
