"""From coded measurement back to spectral cube: operators, bases, solvers, metrics.

The names below are imported when first used, so that ``import recon`` stays light.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Config": "config",
    "InputError": "errors",
    "Operator": "operator",
    "LinearOperator": "operator",
    "GramBlocks": "gram",
    "GramBands": "gram",
    "RowWeighted": "operator",
    "adjoint_error": "operator",
    "norm_squared": "operator",
    "CodedAperture": "coded_aperture",
    "shift_taps": "coded_aperture",
    "empty_cube": "coded_aperture",
    "FieldAperture": "field_aperture",
    "Spread": "spread",
    "Readout": "readout",
    "Basis": "basis",
    "Kronecker": "basis",
    "Cosine": "spectral_basis",
    "Learned": "spectral_basis",
    "learned": "spectral_basis",
    "Gap": "gap",
    "PlugAndPlay": "plug_and_play",
    "Mixture": "mixture",
    "Quality": "quality",
    "PriorChoice": "quality",
    "choose_prior": "quality",
    "never_below": "quality",
    "TotalVariation": "total_variation",
    "SpectralTotalVariation": "total_variation",
    "Prior": "prior",
    "Penalty": "prior",
    "L1": "l1",
    "GroupL1": "l1",
    "Solution": "solution",
    "Stop": "solution",
    "reconstruct": "solve",
    "warm_up": "warm",
    "warm_up_beside": "warm",
    "reconstruct_tiled": "tiles",
    "Tiling": "tiles",
    "Tiled": "tiles",
    "BasisPursuit": "basis_pursuit",
    "Admm": "admm",
    "Fista": "fista",
    "Gpsr": "gpsr",
    "AutoTau": "tau",
    "Discrepancy": "tau",
    "TauFraction": "tau",
    "Displaced": "uncertainty",
    "ErrorEstimate": "uncertainty",
    "estimate_error": "uncertainty",
}

__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"recon.{_HOME[name]}"), name)
    raise AttributeError(f"module 'recon' has no attribute {name!r}")
