"""What a program asks of JAX before anything is computed."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import jax

from kneejax.numerics._compiled import use_shared_fusion
from kneejax.numerics._kept_executables import check_executables
from kneejax.numerics._kept_programs import keep_programs

_CACHE = "jax_compilation_cache_dir"


def configure() -> None:
    """Prepare JAX for kneejax, in all of this process: call it before anything is computed.

    It switches float64 on, lets XLA fuse operations without copying shared values
    (`use_shared_fusion`, five times faster), and keeps programs between runs, as they are traced
    and as they are compiled: in `JAX_COMPILATION_CACHE_DIR` if that is set, otherwise in `kneejax`
    of the user's cache folder (`XDG_CACHE_HOME`, or `~/.cache`). What is damaged there is made
    again; what XLA compiled is machine code, so nobody else may write into that folder. `kneejax`
    on the command line begins with it; importing the package changes nothing. To call it again
    does no harm.

    Warns:
        RuntimeWarning: JAX has begun to compute without it. float64 holds from here on; arrays
            that exist stay as they are, and solves are slower.

    Example:
        >>> import kneejax as kj
        >>> kj.configure()  # doctest: +SKIP
    """
    jax.config.update("jax_enable_x64", True)
    # By name: jax makes these attributes, of which type checkers know nothing.
    # Set to nothing, it is not set: programs would be kept wherever a command is called.
    if not getattr(jax.config, _CACHE):
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        jax.config.update(_CACHE, str(Path(base) / "kneejax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    check_executables()
    keep_programs(Path(getattr(jax.config, _CACHE)) / "traced")
    if not use_shared_fusion():
        warnings.warn(
            "kneejax.configure() comes too late: JAX has begun to compute. float64 is on from "
            "here, but solves stay slower and programs may not be kept; call it first",
            RuntimeWarning,
            stacklevel=2,
        )
