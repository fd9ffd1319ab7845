"""A server as OpenVLA's and OpenVLA-OFT's scripts are, with json-numpy as its only codec.

Prints its address. /act answers with one array, /oft with a list of eight; what fails is answered
by "error". It imports nothing of ours.
"""

# ruff: noqa: T201
# mypy: ignore-errors

import json
from http.server import BaseHTTPRequestHandler, HTTPServer

import json_numpy
import numpy as np

json_numpy.patch()


def action(payload):
    image, instruction = payload["image"], payload["instruction"]
    assert image.shape == (8, 8, 3) and image.dtype == np.uint8
    assert payload.get("unnorm_key") == "bridge_orig"
    return np.array([image.mean(), 0, 0, 0, 0, len(instruction) / 10, 1], np.float32)


class Handler(BaseHTTPRequestHandler):
    def do_POST(self):
        body = self.rfile.read(int(self.headers["Content-Length"]))
        try:
            one = action(json.loads(body))
            answer = [one] * 8 if self.path == "/oft" else one
        except Exception:
            answer = "error"
        self.send_response(200)
        self.send_header("Content-Type", "application/json")
        self.end_headers()
        self.wfile.write(json.dumps(answer).encode())

    def log_message(self, *_):
        pass


server = HTTPServer(("127.0.0.1", 0), Handler)
print(f"http://127.0.0.1:{server.server_port}", flush=True)
server.serve_forever()
