"""Scene x sensor x masks x shots x solver: what to run, what is done, and what it says."""
