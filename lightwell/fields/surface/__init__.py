"""Fields of light at surfaces that are fitted to the same samples: networks, trees, mixtures of experts."""
