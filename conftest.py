"""Doctests of the package compute in float64, like the tests."""

import jax

jax.config.update("jax_enable_x64", True)
