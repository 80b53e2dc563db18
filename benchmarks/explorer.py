"""How long the explorer takes from a slider to the picture, and to the curves that follow.

A client that speaks the page's language moves a slider, as a browser does, and waits until all that
the page draws of the new pose has arrived. The browser's own drawing, on a graphics card, is not
counted. Moves come as fast as they are answered; where a move changes the curves they are waited
for every fifth time.
"""

from __future__ import annotations

import os
import time
from urllib.parse import urlsplit

import numpy as np
from _protocol import arguments, finish

import kneejax as kj
from kneejax.cli._explore import begin
from kneejax.cli.options.knees import Explore

#: Name of a number -> what its slider goes through.
MOVES = {"flexion_deg": (5.0, 35.0), "anterior_N": (0.0, 100.0), "varus_Nm": (-5.0, 5.0)}


def connected(page):
    """A socket of the page, as its own script opens it; a client counts when it has a camera."""
    import msgspec
    import viser
    from websockets.sync.client import connect

    there = urlsplit(page.link)
    cookie = f"kneejax-{there.port}={there.query.removeprefix('token=')}"
    socket = connect(f"ws://{there.netloc}/", origin=f"http://{there.netloc}", max_size=None,
                     additional_headers={"Cookie": cookie},
                     subprotocols=[f"viser-v{viser.__version__}"])  # fmt: skip
    camera = {"wxyz": (1.0, 0.0, 0.0, 0.0), "position": (300.0, 0.0, 0.0), "fov": 0.6,
              "near": 1.0, "far": 1e4, "image_height": 900, "image_width": 1440,
              "look_at": (0.0, 0.0, 0.0), "up_direction": (0.0, 1.0, 0.0)}  # fmt: skip
    socket.send(msgspec.msgpack.encode({"type": "ViewerCameraMessage", **camera}))
    until(lambda: page._server.get_clients())
    return socket


def moved(page, socket, name: str, value: float) -> None:
    """Move a slider, and read until the link of the new setting has come: it is sent last."""
    import msgspec
    import zstandard

    uuid = page._sliders[name]._impl.uuid
    message = {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
    socket.send(msgspec.msgpack.encode(message))
    wanted = f"{name}={value!r}".encode()
    read = zstandard.ZstdDecompressor().decompress
    # viser's messages: two lengths, words that are packed, arrays as they are.
    while wanted not in read((raw := socket.recv(timeout=60.0))[16 : 16 + _length(raw)]):
        pass


def _length(raw: bytes) -> int:
    return int.from_bytes(raw[8:16], "little")


def until(holds) -> None:
    """Wait without taking the processor."""
    while not holds():
        time.sleep(0.005)


def main() -> None:
    asked = arguments("explorer", __doc__, moves=60, port=8490)
    kj.configure()
    begun = time.perf_counter()
    page = begin(Explore.read({"subject": asked.knee, "port": str(asked.port)}))
    rows: dict[str, object] = {"knee": asked.knee, "opened_s": time.perf_counter() - begun}
    page.solved.wait()
    rows["solved_s"] = time.perf_counter() - begun
    socket = connected(page)
    for name, (low, high) in MOVES.items():
        clock, processor, curves = [], [], []
        # Along the slider and back, as a hand does; the first moves are not counted.
        share = 0.5 + 0.5 * np.sin(np.arange(asked.moves + 5) / 6.0)
        for number, value in enumerate(np.round(low + (high - low) * share, 3).tolist()):
            before = time.perf_counter(), time.process_time()
            moved(page, socket, name, value + 1e-4)
            if number >= 5:
                clock.append(time.perf_counter() - before[0])
                processor.append(time.process_time() - before[1])
            if number % 5 == 0:
                until(lambda: page.curves.setting == page.setting)
                curves.append(time.perf_counter() - before[0])
        for what, seconds in (("picture", clock), ("picture_processor", processor),
                              ("curves", curves[1:])):  # fmt: skip
            half, most = 1e3 * np.percentile(seconds, [50, 95])
            rows |= {f"{name}_{what}_median_ms": half, f"{name}_{what}_95_ms": most}
    rows["load_average"] = os.getloadavg()[0]
    socket.close()
    page.stop()
    finish(asked.out, "From a slider to the picture and the curves", rows)


if __name__ == "__main__":
    main()
