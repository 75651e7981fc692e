"""The coded-aperture camera: from a radiance cube at the mirrors to frames, and to the plain arrays of its discrete model.

A cube becomes frames by :func:`measure_matched` (the paper's discrete model makes the data) or by :func:`photograph`
(a fine model of wavelengths and mirrors with the traced prism).
"""

from optsim.camera.band_model import BandModel, matched_model, physical_model
from optsim.camera.camera import CameraConfig
from optsim.camera.center_table import CenterTable
from optsim.camera.differentiable import DifferentiableMeasurement
from optsim.camera.differentiable_optics import DifferentiableOptics, OpticsValues
from optsim.camera.dmd import Distinct, Repeated, defects, masks_for, mirror_states
from optsim.camera.effects import EFFECTS, Effect, effect_named, ranked, reduced, required
from optsim.camera.field_maps import MAPPINGS, FieldPolynomial, ParaxialMap, WholePixel
from optsim.camera.fine import Interpolate
from optsim.camera.fixed_pattern import fixed_pattern
from optsim.camera.frames import band_model_of, check_frames, cube_units_of, signal_of, with_unit_shifts
from optsim.camera.glass import AIR, Glass, glass, glass_names
from optsim.camera.knowledge import Assumed, Exact, OwnShifts, UnitShift
from optsim.camera.known_noise import noise_unknown, noise_variance
from optsim.camera.layer_bins import bin_layers, layer_sites
from optsim.camera.mappings import CauchyMap, LinearMap, PolynomialMap, SplineMap
from optsim.camera.matched import measure_matched
from optsim.camera.noise import Noise
from optsim.camera.objective import through_objective
from optsim.camera.optics import Optics
from optsim.camera.patterns import Bernoulli, BlueNoise, Complementary, FromFile, Stratified
from optsim.camera.physical import Exposure, photograph
from optsim.camera.prism import Dispersion, DoubleAmici
from optsim.camera.prism_figures import plot_prism
from optsim.camera.prism_report import prism_report
from optsim.camera.quattro import Quattro, every_sensor
from optsim.camera.relay import Relay
from optsim.camera.sensor import Bayer, BayerPhase, Foveon, Mono, Sensor, sensors
from optsim.camera.silicon import FrontFilter, SiliconLayers
from optsim.camera.stack import PrismStack

__all__ = [
    "AIR",
    "EFFECTS",
    "MAPPINGS",
    "Assumed",
    "BandModel",
    "Bayer",
    "BayerPhase",
    "Bernoulli",
    "BlueNoise",
    "CameraConfig",
    "CauchyMap",
    "CenterTable",
    "Complementary",
    "DifferentiableMeasurement",
    "DifferentiableOptics",
    "Dispersion",
    "Distinct",
    "DoubleAmici",
    "Effect",
    "Exact",
    "Exposure",
    "FieldPolynomial",
    "Foveon",
    "FromFile",
    "FrontFilter",
    "Glass",
    "Interpolate",
    "LinearMap",
    "Mono",
    "Noise",
    "Optics",
    "OpticsValues",
    "OwnShifts",
    "ParaxialMap",
    "PolynomialMap",
    "PrismStack",
    "Quattro",
    "Relay",
    "Repeated",
    "Sensor",
    "SiliconLayers",
    "SplineMap",
    "Stratified",
    "UnitShift",
    "WholePixel",
    "band_model_of",
    "bin_layers",
    "check_frames",
    "cube_units_of",
    "defects",
    "effect_named",
    "every_sensor",
    "fixed_pattern",
    "glass",
    "glass_names",
    "layer_sites",
    "masks_for",
    "matched_model",
    "measure_matched",
    "mirror_states",
    "noise_unknown",
    "noise_variance",
    "photograph",
    "physical_model",
    "plot_prism",
    "prism_report",
    "ranked",
    "reduced",
    "required",
    "sensors",
    "signal_of",
    "through_objective",
    "with_unit_shifts",
]
