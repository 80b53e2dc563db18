"""Whoever sits at another machine reads nothing of what workers do."""

import os

import pytest

psutil = pytest.importorskip("psutil")
pytest.importorskip("distributed")
pytestmark = pytest.mark.long


def listening():
    """Addresses at which this process and those below it listen."""
    own = psutil.Process()
    return {
        one.laddr.ip
        for process in (own, *own.children(recursive=True))
        for one in process.net_connections("inet")
        if one.status == psutil.CONN_LISTEN
    }


def test_workers_listen_on_this_machine_alone():
    from kneejax.cohorts import workers

    before = listening()
    with workers(1) as client:
        assert client.submit(os.getpid).result() != os.getpid()
        found = listening()
    assert found - before <= {"127.0.0.1", "::1"} and "127.0.0.1" in found
