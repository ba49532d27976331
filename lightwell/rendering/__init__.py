"""Pictures of a scene, by path tracing or with the radiance cache."""
