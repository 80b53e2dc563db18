"""A ready test as a call."""

import kneejax as kj


def curves_of(knee, name, flexion_deg, **options):
    """Curves of the only test of a name."""
    (test,) = kj.lab_tests(name, flexion_deg, **options)
    return kj.load_curves(knee, test)[0]
