"""Tests under load as a laboratory makes them: what acts, what is observed, how far it gives."""

from kneejax.experiments.laboratory._curves import Curves as Curves
from kneejax.experiments.laboratory._curves import load_curves as load_curves
from kneejax.experiments.laboratory._curves import mechanics_of as mechanics_of
from kneejax.experiments.laboratory._lab_test import HELD as HELD
from kneejax.experiments.laboratory._lab_test import LabTest as LabTest
from kneejax.experiments.laboratory._lab_test import load_cycle as load_cycle
from kneejax.experiments.laboratory._laxity import LAXITY_COLUMNS as LAXITY_COLUMNS
from kneejax.experiments.laboratory._laxity import Laxity as Laxity
from kneejax.experiments.laboratory._laxity import laxity as laxity
from kneejax.experiments.laboratory._laxity import second_balances as second_balances
from kneejax.experiments.laboratory._measured_test import COUNTED_FROM as COUNTED_FROM
from kneejax.experiments.laboratory._measured_test import READINGS as READINGS
from kneejax.experiments.laboratory._measured_test import WITHOUT_LOADS as WITHOUT_LOADS
from kneejax.experiments.laboratory._measured_test import MeasuredTest as MeasuredTest
from kneejax.experiments.laboratory._measured_test import counts_like_poses as counts_like_poses
from kneejax.experiments.laboratory._measured_test import reading_unit as reading_unit
from kneejax.experiments.laboratory._measured_test import weights_by_load as weights_by_load
from kneejax.experiments.laboratory._ready import READY as READY
from kneejax.experiments.laboratory._ready import against_load as against_load
from kneejax.experiments.laboratory._ready import lab_tests as lab_tests
