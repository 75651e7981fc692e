"""Dr.Jit and Mitsuba, imported in the right order: libLLVM is chosen before either is loaded.

Import ``dr`` and ``mi`` from here, never directly: the first import of Dr.Jit binds the process to a libLLVM for good.
"""

from optsim.render.backend import start

BACKEND = start()

import drjit as dr  # noqa: E402
import mitsuba as mi  # noqa: E402

__all__ = ["BACKEND", "dr", "mi"]
