"""Decoders of foreign files, one a format: they run in a child process only, and say what a file holds before they read it.

Each has ``LIBRARIES``, ``survey(files) -> list[Found]`` and ``read(files, name) -> ndarray``; what the numbers mean is decided outside, in
:mod:`optsim.files.cube_import`. Those of optsim's own formats have ``extent`` and ``prove`` too (:mod:`optsim.files.proof`).
"""
