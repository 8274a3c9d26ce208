"""A server on this machine that sends files, whole or in part, and breaks off or redirects."""

import threading
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@contextmanager
def server(contents, *, ranges=True, status=200, whole=None, location=None, length=None, pause=None):
    """Address of a server, and the ranges that it is asked for.

    Args:
        contents: What it sends, for all paths or by the last part of the path.
        ranges: True if it can send a part.
        status: Status of its answers.
        whole: Bytes that it says it sends; then it breaks off.
        location: Address to redirect to.
        length: Length that it states instead.
        pause: Seconds before each byte, with a minus before each byte of a header; by default it sends all at once.
    """
    asked, stopped = [], threading.Event()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            given, content = self.headers.get("Range"), contents
            if isinstance(contents, dict):
                content = contents[self.path.rpartition("/")[2]]
            asked.append(given)
            start = int(given.removeprefix("bytes=").rstrip("-")) if given and ranges else 0
            if start >= len(content) and given:
                self.send_error(416)
                return
            self.send_response(206 if start else status)
            if location:
                self.send_header("Location", location)
            if start:
                self.send_header("Content-Range", f"bytes {start}-{len(content) - 1}/{len(content)}")
            self.send_header("Content-Length", length or str((whole or len(content)) - start))
            if pause and pause < 0:
                self.flush_headers()
                self.trickle(b"X-Slow: " + content, -pause)
            self.end_headers()
            if pause:
                self.trickle(content[start:], pause)
            else:
                self.wfile.write(content[start:])

        def trickle(self, content, pause):
            with suppress(OSError):
                for byte in content:
                    if stopped.wait(pause):
                        return
                    self.wfile.write(bytes([byte]))

        def log_message(self, *_):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as httpd:
        thread = threading.Thread(target=httpd.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield f"http://127.0.0.1:{httpd.server_port}", asked
        finally:
            stopped.set()
            httpd.shutdown()
            thread.join()
