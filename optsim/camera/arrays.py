"""Which arrays the optics compute with: NumPy on the host, Dr.Jit (LLVM, or CUDA unchanged) for kernels and gradients.

The formulas of this package are written once, over :class:`Ops`; NumPy and Dr.Jit arrays both run them.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Array = Any
"""A float, NumPy array or Dr.Jit array; each function says which shapes it takes."""


@dataclass(frozen=True)
class Ops:
    """Hold the few operations that differ between NumPy and Dr.Jit.

    Args:
        sqrt, sin, cos: elementwise functions.
        where: ``where(mask, a, b)`` elementwise choice.
        fma: a b + c; rounded once where the arrays can.
        sincos: (sin, cos) of one angle, cheaper than both apart.
    """

    sqrt: Callable[[Array], Array]
    sin: Callable[[Array], Array]
    cos: Callable[[Array], Array]
    where: Callable[[Array, Array, Array], Array]
    fma: Callable[[Array, Array, Array], Array]
    sincos: Callable[[Array], tuple[Array, Array]]


NUMPY = Ops(np.sqrt, np.sin, np.cos, np.where, lambda a, b, c: a * b + c, lambda t: (np.sin(t), np.cos(t)))


@dataclass(frozen=True)
class Kernels:
    """Hold Dr.Jit and one backend's array types, with automatic differentiation.

    Args:
        dr: the drjit module.
        backend: the module of array types, ``drjit.llvm.ad`` or ``drjit.cuda.ad``.
    """

    dr: types.ModuleType
    backend: types.ModuleType

    @property
    def ops(self) -> Ops:
        """Return the formulas' operations on this backend's arrays."""
        return Ops(self.dr.sqrt, self.dr.sin, self.dr.cos, self.dr.select, self.dr.fma, self.dr.sincos)

    def opaque(self, kind: Any, value: float) -> Array:
        """Return a scalar that is an input of a kernel, not a literal in it: a new value does not recompile."""
        return self.dr.opaque(kind, value)


@functools.cache
def kernels() -> Kernels | None:
    """Return Dr.Jit on LLVM, or None where no usable libLLVM is found (the caller then computes with NumPy)."""
    from optsim.llvm import use_llvm

    if not use_llvm().usable:
        return None
    import drjit
    import drjit.llvm.ad

    return Kernels(drjit, drjit.llvm.ad)
