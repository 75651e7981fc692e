"""Design by gradient: prisms for a wanted dispersion, masks of small expected error (theory.md C.j)."""

from optsim.camera.design.band_camera import BandCamera
from optsim.camera.design.expected_error import ErrorEstimate, ExpectedError
from optsim.camera.design.mask_design import DesignedMasks, MaskDesign
from optsim.camera.design.prior import GaussianPrior
from optsim.camera.design.prism_design import PrismDesign, PrismResult
from optsim.camera.design.wanted import WantedDispersion

__all__ = [
    "BandCamera",
    "DesignedMasks",
    "ErrorEstimate",
    "ExpectedError",
    "GaussianPrior",
    "MaskDesign",
    "PrismDesign",
    "PrismResult",
    "WantedDispersion",
]
