"""OpenSim models: read in stages, written back as changed numbers."""
