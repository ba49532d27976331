"""Neural light maps: an atlas, its irradiance, and a network that reads features of its texels."""
