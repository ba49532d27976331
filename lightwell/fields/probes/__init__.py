"""The field ``probes``: a lattice of light probes whose light is a learned function of the variable light."""
