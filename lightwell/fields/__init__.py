"""Learned representations: each prepares a scene, samples it, fits and lowers to a shading graph (``protocol``)."""
