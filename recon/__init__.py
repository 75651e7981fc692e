"""From coded measurement back to spectral cube: operators, bases, solvers, metrics."""
