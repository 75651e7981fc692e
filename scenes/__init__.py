"""What stands in front of the camera: typed, engine-free scenes and their spectra."""
