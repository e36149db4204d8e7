"""Replay many recordings, in local processes or on a dask cluster."""
