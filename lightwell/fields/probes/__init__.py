"""Light probes as a field: a lattice of learned probes whose light is a function of the light that moves."""
