"""The server behind `make annotate`: this machine only, one address with a secret in it, and every request looked at first.

Why Bokeh: of the toolkits with a server and without a build step it alone brings what drawing needs: a canvas that zooms, pans and
pinches, points that are dragged by mouse and finger without a word to the server, and a live connection that keeps Python and
browser alike. It brings six small packages, Tornado the chief of them. Panel is Bokeh again with some fifteen packages more, among
them pandas, for widgets that we do not use. NiceGUI has the prettier widgets and forty packages, but an image with mouse events where
zoom, pan, handles and touch would all be ours to write. Ours is now what Bokeh leaves open: which drag moves a point and which the
view, keys, and panels of plain HTML (templates/annotate).

`Guard` stands before all of it, Bokeh's websocket and files among them: Host and Origin must be this server's own, so that no page
of the web reaches it by a name that points here (DNS rebinding) or from the same browser, and the address must begin with the token.
"""

from __future__ import annotations

import gc
import hmac
import logging
import secrets
import signal
import tempfile
import webbrowser
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from bokeh.application import Application
from bokeh.application.handlers import FunctionHandler
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado import httputil, netutil, web
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop, PeriodicCallback
from tornado.routing import Router

from pipeline.annotate.page.desk import LOOK_EVERY
from pipeline.annotate.page.studio import Studio
from pipeline.annotate.page.uploads import MOST_BYTES, Upload
from pipeline.errors import InputError

log = logging.getLogger(__name__)
#: Loopback by its number: a name may be made to mean something else.
ADDRESS = "127.0.0.1"
#: Bytes of what a browser says over the websocket in one message: commands and coordinates.
MOST_MESSAGE = 2_000_000
#: A tab that went away is forgotten after so long [ms].
UNUSED = 2_000


class Guard(Router):
    """Refuses what is not from this server's own page, before anything else looks at it."""

    def __init__(self, inner: Router, port: int, token: str):
        self.inner, self.token = inner, token
        self.hosts = {f"{ADDRESS}:{port}", f"localhost:{port}"}
        self.origins = {f"http://{host}" for host in self.hosts}

    def find_handler(self, request: httputil.HTTPServerRequest, **kwargs):
        status = self.refuses(request)
        return Refusal(request, status) if status else self.inner.find_handler(request, **kwargs)

    def refuses(self, request: httputil.HTTPServerRequest) -> int:
        """An HTTP status that refuses the request, or 0."""
        hosts, origins = request.headers.get_list("Host"), request.headers.get_list("Origin")
        if len(hosts) != 1 or hosts[0].lower() not in self.hosts:
            return 403
        if len(origins) > 1 or origins and origins[0].lower() not in self.origins:
            return 403
        upgrade = request.headers.get("Upgrade", "").lower() == "websocket"
        if (upgrade or request.method not in ("GET", "HEAD")) and not origins:
            return 403  # a browser always says where these come from
        if request.headers.get("Sec-Fetch-Site", "same-origin") not in ("same-origin", "none"):
            return 403
        stated = request.path.split("/")[1] if request.path.startswith("/") else ""
        # 404 for a wrong token: nothing tells that there is a right one
        return 0 if hmac.compare_digest(stated.encode(), self.token.encode()) else 404


class Refusal(httputil.HTTPMessageDelegate):
    """An answer without a body's being read."""

    def __init__(self, request: httputil.HTTPServerRequest, status: int):
        self.connection, self.status = request.connection, status

    def headers_received(self, start_line, headers):
        self.connection.write_headers(
            httputil.ResponseStartLine("HTTP/1.1", self.status, "refused"),
            httputil.HTTPHeaders({"Content-Length": "0", "Connection": "close", "X-Content-Type-Options": "nosniff"}))
        self.connection.finish()


class Held(web.RequestHandler):
    """A picture that the server holds: the photograph, the fog, or what was rendered."""

    def initialize(self, studio: Studio):
        self.studio = studio

    def set_default_headers(self):
        for name, value in HEADERS.items():
            self.set_header(name, value)

    def get(self, scene: str, name: str):
        picture = self.studio.picture(scene, name)
        if picture is None:
            raise web.HTTPError(404)
        self.set_header("Content-Type", "image/jpeg")
        self.set_header("Cache-Control", "no-store" if name == "clear" else "private, max-age=60")
        self.write(picture)


HEADERS = {"X-Content-Type-Options": "nosniff", "Referrer-Policy": "no-referrer", "X-Frame-Options": "DENY",
           "Cross-Origin-Resource-Policy": "same-origin", "Cross-Origin-Opener-Policy": "same-origin"}


class Server:
    """A running server: `address` is what to open. `studio` holds the scenes that are on the desk."""

    def __init__(self, scenes: Path, builds: Path, scene: str, port: int = 0, token: str | None = None, preview=None):
        self.token = token or secrets.token_urlsafe(24)
        self.loop = IOLoop.current()
        self.folder = tempfile.TemporaryDirectory(prefix="annotate-")
        try:
            sockets = netutil.bind_sockets(port, ADDRESS)
        except OSError as error:
            raise InputError(f"port {port}: {error.strerror}", place="this machine", remedy="leave port= out for a free one") from None
        self.port = sockets[0].getsockname()[1]
        self.studio = Studio(scenes, builds, Path(self.folder.name), scene, self.loop, preview)
        application = Application(FunctionHandler(self.studio.open_page))
        prefix = f"/{self.token}"
        self.bokeh = BokehTornado(
            {"/": application}, prefix=prefix, use_index=False, redirect_root=False,
            extra_websocket_origins=[f"{ADDRESS}:{self.port}", f"localhost:{self.port}"],
            extra_patterns=[(r"/picture/([^/]+)/([a-z]+)(?:/\d+)?", Held, {"studio": self.studio}),
                            (r"/upload", Upload, {"studio": self.studio})],
            websocket_max_message_size_bytes=MOST_MESSAGE, unused_session_lifetime_milliseconds=UNUSED,
            check_unused_sessions_milliseconds=UNUSED // 2, log_function=lambda handler: None)
        guard = Guard(self.bokeh, self.port, self.token)
        http = HTTPServer(guard, max_header_size=32_768, max_body_size=MOST_BYTES, idle_connection_timeout=600)
        http.add_sockets(sockets)
        self.server = BaseServer(self.loop, self.bokeh, http)
        self.looking = PeriodicCallback(self.studio.look, LOOK_EVERY * 1000)

    @property
    def address(self) -> str:
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    def start(self) -> None:
        self.server.start()
        self.looking.start()

    def stop(self) -> None:
        self.looking.stop()
        self.server.stop(wait=False)
        self.studio.close()
        self.folder.cleanup()


def serve(scenes: Path, builds: Path, scene: str, port: int = 0, browse: bool = True) -> None:
    """Serves until it is interrupted."""
    logging.getLogger("bokeh").setLevel(logging.ERROR)
    server = Server(scenes, builds, scene, port)
    server.start()
    # what was imported stays: looked through for garbage it would hold up a slider for 0.15 s now and then
    gc.collect()
    gc.freeze()
    print(f"open {server.address}\nCtrl-C ends it; what the page changes is saved as you go", flush=True)
    for one in (signal.SIGTERM, signal.SIGINT):
        signal.signal(one, lambda *_: server.loop.add_callback_from_signal(server.loop.stop))
    if browse:
        # a browser in a terminal would take it over, and one that cannot be started is no harm
        ThreadPoolExecutor(1).submit(webbrowser.open, server.address)
    try:
        server.loop.start()
    finally:
        gc.unfreeze()
        server.stop()
