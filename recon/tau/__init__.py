"""Choosing tau: as a fraction of tau_max, from pixels held out, or from known noise (theory.md (S.37), (S.80))."""

from recon.tau.choice import Given, TauChoice, TauFraction, TauRule, tau_max
from recon.tau.discrepancy import Discrepancy
from recon.tau.held_out import AutoTau
from recon.tau.path import OnPoint, TauPath
from recon.tau.report import TauReport, tune

__all__ = [
    "AutoTau",
    "Discrepancy",
    "Given",
    "OnPoint",
    "TauChoice",
    "TauFraction",
    "TauPath",
    "TauReport",
    "TauRule",
    "tau_max",
    "tune",
]
