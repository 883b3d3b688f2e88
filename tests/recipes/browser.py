"""Opens a page in headless Chromium, served from folders of this machine, and waits for what the page posts to
/result."""
import http.server
import json
import os
import shutil
import subprocess
import tempfile
import threading

FLAGS = ['--headless', '--no-sandbox', '--disable-gpu', '--use-gl=angle', '--use-angle=swiftshader',
         '--enable-unsafe-swiftshader', '--disable-quic',
         '--no-first-run', '--disable-background-networking', '--disable-component-update', '--disable-sync',
         '--disable-dev-shm-usage']


def find():
    """Path of a Chromium or Chrome, or None."""
    return next((p for p in map(shutil.which, ('chromium', 'chromium-browser', 'google-chrome')) if p), None)


class Server:
    """Serves {'': FOLDER, 'bake': FOLDER, ...}, the first part of a path chooses, and `files` {name: bytes}."""

    def __init__(self, folders, files):
        self.folders, self.files, self.result, self.arrived = folders, files, None, threading.Event()
        self.http = http.server.ThreadingHTTPServer(('127.0.0.1', 0), self._handler())
        threading.Thread(target=self.http.serve_forever, daemon=True).start()

    def url(self, path):
        return 'http://127.0.0.1:%d/%s' % (self.http.server_address[1], path)

    def close(self):
        self.http.shutdown()
        self.http.server_close()

    def _path(self, path):
        first, _, rest = path.lstrip('/').partition('/')
        return os.path.join(self.folders[first],
                            rest) if first in self.folders else os.path.join(self.folders[''], path.lstrip('/'))

    def _handler(outer):
        class Handler(http.server.SimpleHTTPRequestHandler):
            extensions_map = {**http.server.SimpleHTTPRequestHandler.extensions_map, '.js': 'text/javascript'}

            def translate_path(self, path):
                return outer._path(path.partition('?')[0])

            def do_GET(self):
                name = self.path.partition('?')[0].lstrip('/')
                if name not in outer.files:
                    return super().do_GET()
                self.send_response(200)
                self.end_headers()
                self.wfile.write(outer.files[name])

            def do_POST(self):
                outer.result = json.loads(self.rfile.read(int(self.headers['Content-Length'])))
                self.send_response(204)
                self.end_headers()
                outer.arrived.set()

            def log_message(self, *_):
                pass
        return Handler


def ask(chromium, server, page, timeout):
    """What the page posts; RuntimeError with Chromium's words when nothing comes in time."""
    profile, log = tempfile.mkdtemp(prefix='kiln-chromium-'), tempfile.TemporaryFile()
    child = subprocess.Popen([chromium, *FLAGS, '--user-data-dir=' + profile, '--remote-debugging-port=0',
                              server.url(page)], stdout=log, stderr=log)
    try:
        for _ in range(int(timeout * 2)):
            if server.arrived.wait(0.5) or child.poll() is not None:
                break
        if not server.arrived.is_set():
            log.seek(0)
            raise RuntimeError('the page posted nothing:\n' + log.read().decode('utf-8', 'replace')[-2000:])
        return server.result
    finally:
        child.terminate()
        child.wait()
        shutil.rmtree(profile, ignore_errors=True)


def _shown(chromium, server, page, flags, timeout):
    """Opens the page, lets its own clock run for a minute at most, and returns what Chromium prints."""
    profile = tempfile.mkdtemp(prefix='kiln-chromium-')
    try:
        return subprocess.run([chromium, *FLAGS, '--user-data-dir=' + profile, '--virtual-time-budget=60000', *flags,
                               server.url(page)],
                              stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=timeout,
                              check=True).stdout.decode('utf-8', 'replace')
    finally:
        shutil.rmtree(profile, ignore_errors=True)


def screenshot(chromium, server, page, path, size=(960, 720), timeout=300):
    """A picture of the page once it has drawn."""
    _shown(chromium, server, page, ['--window-size=%d,%d' % size, '--screenshot=' + path], timeout)


def document(chromium, server, page, timeout=300):
    """The page's text once it has drawn, as HTML."""
    return _shown(chromium, server, page, ['--dump-dom'], timeout)
