"""Neural light maps: an atlas, the light that arrives on it, and a network that reads features of its texels."""
