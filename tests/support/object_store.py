# SPDX-License-Identifier: GPL-3.0-or-later
"""An object store on this machine alone: moto's server on loopback, which speaks S3, and its environment."""

import logging
import urllib.request

ACCESS = {"AWS_ACCESS_KEY_ID": "nobody", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_DEFAULT_REGION": "us-east-1"}


class ObjectStore:
    """A running store. environment: leads s3:// to it, for this process and those that it starts."""

    def __init__(self):
        from moto.server import ThreadedMotoServer

        logging.getLogger("werkzeug").setLevel(logging.ERROR)
        self._server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
        self._server.start()
        host, port = self._server.get_host_and_port()
        self.endpoint = f"http://{host}:{port}"
        self.environment = {**ACCESS, "AWS_ENDPOINT_URL": self.endpoint}

    def bucket(self, name):
        """Make an empty bucket; return an address in it."""
        request = urllib.request.Request(f"{self.endpoint}/{name}", method="PUT")
        assert urllib.request.urlopen(request, timeout=10).status == 200
        return f"s3://{name}/noisy"

    def stop(self):
        self._server.stop()
