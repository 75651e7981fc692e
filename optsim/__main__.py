"""``python -m optsim`` is ``optsim``."""

from optsim.cli import main

main()
