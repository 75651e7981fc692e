"""From a spectral scene to the verdict on three sensors: render, photograph, reconstruct, score."""

__version__ = "0.1.0"
