"""The field ``factored+probes``: the default field for what stands still, light probes for what is added or moves."""
