"""Tracing on many machines with Dask. Nothing here is imported without ``--cluster``."""
