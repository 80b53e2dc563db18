"""Compiling, lanes, all cores, elimination, safe primitives. Knows no knee."""

from kneejax.numerics._arctangent import arctan2 as arctan2
from kneejax.numerics._compiled import collect_seldom as collect_seldom
from kneejax.numerics._compiled import compiled as compiled
from kneejax.numerics._compiled import compiler_options as compiler_options
from kneejax.numerics._compiled import compiling as compiling
from kneejax.numerics._compiled import share_memory_between_threads as share_memory_between_threads
from kneejax.numerics._compiled import use_shared_fusion as use_shared_fusion
from kneejax.numerics._configure import configure as configure
from kneejax.numerics._cores import on_all_cores as on_all_cores
from kneejax.numerics._elimination import identity as identity
from kneejax.numerics._elimination import solve as solve
from kneejax.numerics._elimination import symmetric as symmetric
from kneejax.numerics._kept_programs import keep_programs as keep_programs
from kneejax.numerics._lanes import filled as filled
from kneejax.numerics._lanes import lanes_for as lanes_for
from kneejax.numerics._lanes import traced as traced
from kneejax.numerics._optional import MissingPackage as MissingPackage
from kneejax.numerics._optional import check_installed as check_installed
from kneejax.numerics._optional import imported as imported
from kneejax.numerics._safe import branch as branch
from kneejax.numerics._safe import positive_part as positive_part
from kneejax.numerics._safe import safe_sqrt as safe_sqrt
from kneejax.numerics._tangents import instantiate as instantiate
from kneejax.numerics._tangents import none_of as none_of
from kneejax.numerics._wrong_value import WrongValue as WrongValue
