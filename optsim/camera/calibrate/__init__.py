"""Calibration: from spots of known wavelength to the camera's curve, its registration and how well they are known."""

from optsim.camera.calibrate.calibrated_map import CalibratedMap
from optsim.camera.calibrate.centroid import find_spots
from optsim.camera.calibrate.figures import plot_calibration
from optsim.camera.calibrate.fit import calibrate
from optsim.camera.calibrate.parameters import Parameter, Tolerances
from optsim.camera.calibrate.prism_model import PrismModel, prism_model
from optsim.camera.calibrate.result import Calibration, Curve
from optsim.camera.calibrate.simulate import Simulated, simulate_spots, spot_grid
from optsim.camera.calibrate.spots import Spots, read_spots

__all__ = [
    "CalibratedMap",
    "Calibration",
    "Curve",
    "Parameter",
    "PrismModel",
    "Simulated",
    "Spots",
    "Tolerances",
    "calibrate",
    "find_spots",
    "plot_calibration",
    "prism_model",
    "read_spots",
    "simulate_spots",
    "spot_grid",
]
