"""Choose Mitsuba's variant, and tell what this machine can render with."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import warnings
from dataclasses import dataclass
from functools import lru_cache

from optsim.llvm import MIN_MAJOR, LlvmReport, choose, prove, use_llvm
from recon.threads import cores

VECTOR_VARIANT = "llvm_ad_spectral"
SCALAR_VARIANT = "scalar_spectral"
FALLBACK_COST = (
    "about 2 times slower, and 4 to 48 times more time for the same noise, because Mitsuba's own film samples four wavelengths a ray"
)
_LIBRARIES = ("optsim", "mitsuba", "drjit", "numpy", "scipy", "xarray", "numba", "PyWavelets", "karellen-llvm-core")


@dataclass(frozen=True)
class Backend:
    """Name Mitsuba's variant in use and the libLLVM behind it."""

    variant: str
    llvm: LlvmReport

    @property
    def vectorised(self) -> bool:
        """Tell whether the Dr.Jit integrators can run; else Mitsuba's film renders (reference.py)."""
        return self.variant == VECTOR_VARIANT


@lru_cache(maxsize=1)
def start() -> Backend:
    """Find LLVM, import Mitsuba and set its variant, once per process; warn and fall back rather than fail.

    Returns:
        ``llvm_ad_spectral`` with a usable libLLVM, else ``scalar_spectral``.
    """
    llvm = use_llvm()
    backend = Backend(VECTOR_VARIANT if llvm.usable else SCALAR_VARIANT, llvm)
    if not backend.vectorised:
        refused = "; ".join(f"{r.path}: {r.reason}" for r in llvm.refused) or "none found"
        warnings.warn(
            f"no libLLVM of version {MIN_MAJOR} or newer ({refused}); rendering with {SCALAR_VARIANT}: {FALLBACK_COST}. "
            "Set DRJIT_LIBLLVM_PATH to a newer libLLVM, or install one.",
            RuntimeWarning,
            stacklevel=2,
        )
    import mitsuba as mi

    mi.set_variant(backend.variant)
    return backend


@lru_cache(maxsize=1)
def versions() -> dict[str, str]:
    """Return the versions of the libraries that a cube depends on, as installed; don't change the answer."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    return found


def memory_gib() -> float | None:
    """Return the machine's memory in GiB, or None where the system does not tell."""
    try:
        return round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 2)
    except (AttributeError, ValueError, OSError):
        return None


def doctor() -> dict[str, object]:
    """Prove the renderer on this machine, in a child process, and report.

    Every candidate libLLVM is tried anew, nothing is taken from a cache, and this process loads none of them.

    Returns:
        ``variant``, ``render_ok``, ``llvm_path``, ``llvm_version``, ``cores``, ``memory_gib``, ``versions``;
        beside these ``llvm_proof``, ``llvm_refused`` (path and reason) and ``advice`` (empty when all is well).
    """
    llvm = choose(always_prove=True)
    verdict = {"ok": True, "reason": ""} if llvm.usable else prove(None, use_cache=False)
    advice = ""
    if not llvm.usable:
        advice = f"LLVM {MIN_MAJOR} or newer is needed for speed; without it: {FALLBACK_COST}."
    if not verdict["ok"]:
        advice += f" The scalar renderer failed too: {verdict['reason']}"
    return {
        "variant": VECTOR_VARIANT if llvm.usable else SCALAR_VARIANT,
        "render_ok": bool(verdict["ok"]),
        "llvm_path": llvm.path,
        "llvm_version": llvm.version,
        "cores": cores(),
        "memory_gib": memory_gib(),
        "versions": dict(versions()),
        "llvm_proof": llvm.proof,
        "llvm_refused": [{"path": r.path, "reason": r.reason} for r in llvm.refused],
        "advice": advice.strip(),
    }
