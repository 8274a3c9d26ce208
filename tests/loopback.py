"""A server on this machine that sends files, whole or until it breaks off."""

import threading
import time
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@contextmanager
def server(contents, *, status=200, whole=None, location=None, pause=0.0):
    """Address of a server that may lie about the size, redirect or pause, and the files that it is asked for."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            name = self.path.rpartition("/")[2]
            content = contents[name] if isinstance(contents, dict) else contents
            asked.append(name)
            self.send_response(status)
            self.send_header("Content-Length", str(whole or len(content)))
            if location is not None:
                self.send_header("Location", location)
            self.end_headers()
            with suppress(ConnectionError):
                for k in range(0, len(content), 1 if pause else len(content) or 1):
                    self.wfile.write(content[k : k + 1] if pause else content)
                    time.sleep(pause)

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{httpd.server_port}", asked
        finally:
            httpd.shutdown()
            thread.join()
