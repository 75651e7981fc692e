"""Figures, one offline page and quick pictures: what a run found, in numbers that the run computed."""
