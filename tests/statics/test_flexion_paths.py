"""Which way leads to a load case: its own, whatever else is asked for."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kneejax.mechanics import load_of
from kneejax.statics import LoadCases
from kneejax.statics._flexion_paths import Routes


def ways(routes):
    """Flexion and loads of all nodes on the way to each load case, from the reference on."""
    before = {}
    for way in (1, -1):
        chain = routes.bent(routes.home, way)
        before |= dict(zip(chain.nodes, (routes.home, *chain.nodes), strict=False))
    for chain in (*routes.hops, *(c for stage in routes.loading for c in stage)):
        before |= dict(zip(chain.nodes, (chain.origin, *chain.nodes), strict=False))
    nodes, found = routes.nodes, []
    for node in routes.asked:
        way = [int(node)]
        while way[-1] != routes.home:
            way.append(before[way[-1]])
        rows = np.array(way)
        loads = [np.hstack([x.force[rows], x.moment[rows]]) for x in nodes.loads]
        found.append((np.asarray(nodes.flexion)[rows], np.array(loads)))
    return found


ANGLES = st.lists(st.integers(-20, 130), min_size=1, max_size=6)


@settings(max_examples=50, deadline=None)
@given(ANGLES, st.integers(0, 30))
def test_an_unloaded_station_is_reached_alike_whatever_else_is_asked_for(angles, reference):
    together = ways(Routes(LoadCases.at(angles), np.deg2rad(reference)))
    for angle, (flexion, _) in zip(angles, together, strict=True):
        (alone, _), = ways(Routes(LoadCases.at([angle]), np.deg2rad(reference)))
        np.testing.assert_allclose(flexion, alone)
        np.testing.assert_allclose(np.rad2deg(flexion[[0, -1]]), [angle, reference], atol=1e-9)
        assert np.abs(np.diff(flexion)).max(initial=0.0) < np.deg2rad(5.0) + 1e-8


def test_loads_grow_one_after_the_other_and_pass_lighter_ones():
    axial = load_of(compression_N=np.array([0.0, 300.0, 300.0, 300.0]))
    moment = load_of(varus_Nm=np.array([0.0, 0.0, 20.0, 10.0]))
    routes = Routes(LoadCases.at(np.full(4, 10.0), [axial, moment]), 0.0)
    first, second = routes.loading
    assert [len(chain.nodes) for chain in (*first, *second)] == [1, 2]
    assert second[0].origin == first[0].nodes[0] == routes.asked[1]
    assert list(second[0].nodes) == [routes.asked[3], routes.asked[2]]
    assert second[0].sizes == pytest.approx((10e3 / 30, 20e3 / 30))


def test_loads_in_other_directions_share_only_the_unloaded_pose():
    drawer = load_of(anterior_N=np.array([100.0, -100.0, 50.0]))
    routes = Routes(LoadCases.at(np.full(3, 30.0), [drawer]), 0.0)
    (chains,) = routes.loading
    assert sorted(chain.nodes for chain in chains) == sorted(
        [(routes.asked[2], routes.asked[0]), (routes.asked[1],)]
    )
    (origin,) = {chain.origin for chain in chains}
    assert origin in routes.stem
    assert np.rad2deg(routes.nodes.flexion[origin]) == pytest.approx(30.0)


def test_a_helping_pose_between_two_angles_hangs_off_the_stem():
    routes = Routes(LoadCases.at([12.0]), 0.0)
    (hop,) = routes.hops
    assert np.rad2deg(routes.nodes.flexion[hop.origin]) == pytest.approx(10.0)
    (back,) = routes.back
    assert np.rad2deg(routes.nodes.flexion[back.origin]) == pytest.approx(15.0)
    assert len(routes.stem) == 4
