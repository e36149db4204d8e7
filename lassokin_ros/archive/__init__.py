"""Replay over many recordings, by processes or on a dask cluster."""
