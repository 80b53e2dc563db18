"""What the explorer's server refuses: other machines, other sites, malformed messages."""

import contextlib
import http.client
import json
import os
import time
from urllib.parse import urlsplit

import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed: kneejax[explore]")
from kneejax.explorer import Setting
from tests.explore.waiting import settled, until


def status(page, path="/", **headers):
    there = urlsplit(page.link)
    connection = http.client.HTTPConnection(there.hostname, there.port, timeout=10)
    connection.putrequest("GET", path, skip_host="Host" in headers)
    for name, value in headers.items():
        connection.putheader(name, value)
    connection.endheaders()
    with contextlib.closing(connection), connection.getresponse() as answer:
        answer.read()
        return answer.status


def token(page):
    return f"/?{urlsplit(page.link).query}"


def test_only_this_machine_with_the_token_is_answered(page):
    assert page._server.get_host() == "127.0.0.1"
    assert status(page, token(page)) == 200
    assert status(page) == 403
    assert status(page, "/?token=wrong") == 403
    assert status(page, token(page), Host="evil.example") == 403
    assert status(page, token(page), Origin="http://evil.example") == 403
    assert status(page, Cookie="a=b; kneejax-8410=wrong") == 403


def socket(page, origin=None, cookie=True):
    from websockets.sync.client import connect

    there = urlsplit(page.link)
    own = f"http://{there.netloc}" if origin is None else origin
    secret = there.query.removeprefix("token=")
    headers = {"Cookie": f"kneejax-{there.port}={secret}"} if cookie else {}
    return connect(f"ws://{there.netloc}/", origin=own or None, additional_headers=headers,
                   subprotocols=[f"viser-v{__import__('viser').__version__}"])  # fmt: skip


@pytest.mark.parametrize("how", [{"cookie": False}, {"origin": "http://evil.example"},
                                 {"origin": ""}])  # fmt: skip
def test_a_socket_of_another_site_is_refused(page, how):
    from websockets.exceptions import InvalidStatus

    with pytest.raises(InvalidStatus), socket(page, **how):
        pass


def test_malformed_messages_have_no_effect(page, capfd):
    import msgspec

    page.go(Setting())
    settled(page)
    rng, pack = np.random.default_rng(0), msgspec.msgpack.encode
    flexion = page._sliders["flexion_deg"]._impl.uuid
    odd = [float("nan"), float("inf"), 1e9, "60", None, [60.0], {"a": 1}, True, b"x"]
    messages = [pack({"type": "GuiUpdateMessage", "uuid": flexion, "updates": {"value": x}})
                for x in odd]  # fmt: skip
    messages += [pack({"type": "GuiUpdateMessage", "uuid": flexion, "updates": {x: 1.0}})
                 for x in ("update_cb", "min", "removed", "__class__")]  # fmt: skip
    messages += [pack({"type": x}) for x in ("ShareUrlRequest", "RunJavascriptMessage", "Nothing")]
    messages += [pack({"type": "TransformControlsUpdateMessage", "name": "/ends/x", "wxyz": x,
                       "position": x}) for x in ([], [1.0], "a", [None] * 3)]  # fmt: skip
    messages += [json.dumps({"type": "GuiUpdateMessage"}).encode(), pack([1]), pack("x"), b""]
    messages += [rng.bytes(int(n)) for n in rng.integers(0, 300, 300 - len(messages))]

    before = page.setting
    assert before == Setting()
    with socket(page) as connection:
        for message in [*messages, "words"]:
            connection.send(message)
        time.sleep(1.0)
        assert page.setting == before
        # The connection still lives, and a good message has its effect.
        good = {"type": "GuiUpdateMessage", "uuid": flexion, "updates": {"value": 10}}
        connection.send(pack(good))
        until(lambda: page._sliders["flexion_deg"].value == 10.0)
    assert page._server._share_tunnel is None
    assert "Traceback" not in "".join(capfd.readouterr())


def test_nothing_is_written_without_a_folder(tmp_path, page):
    names = {path.name.split("-")[0] for path in page.folder.path.iterdir()}
    assert names <= {"explore"} and os.listdir(tmp_path) == []
