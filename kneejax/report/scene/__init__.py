"""A knee in space: scenes, pressure, renderings, the interactive page."""
