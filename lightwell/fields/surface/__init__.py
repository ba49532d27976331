"""Fields of light at surfaces that learn from the same samples: networks, trees, mixtures of experts."""
