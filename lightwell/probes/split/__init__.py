"""A feature volume: light in the air on a grid whose nodes are split at walls, the competitor of probes."""
