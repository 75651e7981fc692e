"""The command line: words become objects here and nowhere else."""

from optsim.cli.app import main

__all__ = ["main"]
