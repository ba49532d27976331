"""lightwell learns the indirect light of a scene and plays it back in real time."""

__version__ = "0.1.0"
