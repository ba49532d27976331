"""The field ``volume``: light in the air on a grid that is split at walls, the competitor of light probes."""
