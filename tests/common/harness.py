"""What the Python tests share: running kiln, reading what a bake leaves behind, finding scenes, printing tables.

Every test is a program, `test.py --kiln PATH`, whose exit code is 0 (passed), 1 (failed) or 77 (skipped, with a
sentence). It runs under /usr/bin/python3 with numpy and h5py. A failed check prints the command that repeats it.
"""
import argparse
import contextlib
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import h5py
import numpy as np

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import exr  # noqa: E402
from ranks import MPI_ENVIRONMENT, under_mpi  # noqa: E402
from reading import run_json  # noqa: E402

REPOSITORY = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
DATA = os.path.join(REPOSITORY, 'tests', 'data')
SHARED = os.path.normpath(os.path.join(REPOSITORY, '..', 'shared', 'scenes'))
SKIPPED = 77
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
BAD_INPUT = 65
NO_DEVICE = 69
VALIDATION = 'Vulkan validation'  # begins the lines in which kiln passes on what Vulkan's validation layer says
FALLBACK = 'going on with Embree'  # ends the warning that a device has failed for good


def skip(sentence):
    print('skipped: ' + sentence)
    sys.exit(SKIPPED)


def need_shared(*parts):
    """A path below ../shared/scenes, or the end of the test."""
    path = os.path.join(SHARED, *parts)
    if not os.path.exists(path):
        skip('../shared/scenes/%s is not here.' % '/'.join(parts))
    return path


def own_scene(*parts):
    """A scene of the project's own: the copy in tests/data, else the one in ../shared/scenes/own, else None."""
    for root in (DATA, os.path.join(SHARED, 'own')):
        path = os.path.join(root, *parts)
        if os.path.exists(path):
            return path
    return None


class Run:
    """One finished command: status, what it printed, how long it took, the processor time of it and its children
    (user and system), and the most memory it held."""

    def __init__(self, command, status, stdout, stderr, seconds, usage, timed_out):
        self.command, self.status, self.stdout, self.stderr = command, status, stdout, stderr
        self.seconds, self.timed_out = seconds, timed_out
        self.processor, self.peak_bytes = usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024

    def line(self):
        return ' '.join("'%s'" % a if ' ' in a else a for a in self.command)

    def sentence(self):
        """The last line on stderr: what kiln says when it fails."""
        lines = [l for l in self.stderr.strip().splitlines() if l.strip()]
        return lines[-1] if lines else ''

    def json(self):
        """The JSON object on stdout."""
        return json.loads(self.stdout)


def own_status(status, errors):
    """The status that the ranks ended with, where mpirun's says something else. A rank that ends waits five seconds at
    most for mpirun's answer. If mpirun had no processor time for so long, it ends with 1 and "exiting improperly",
    although that rank ended with 0: another status would be mpirun's too, and kiln's are 64 or more."""
    if status == 1 and 'exiting improperly' in errors and 'kiln: error' not in errors:
        print('mpirun got too little processor time to see how a rank ended; its status 1 is taken for 0', flush=True)
        return 0
    return status


def run(command, timeout=600, environment=None):
    """Runs `command` to its end. After `timeout` seconds it and its children are killed and timed_out is set."""
    env = dict(os.environ)
    env.update(environment or {})
    start = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
        child = subprocess.Popen(command, stdout=out, stderr=err, stdin=subprocess.DEVNULL, env=env,
                                 start_new_session=True)
        timed_out = False
        usage = None
        while True:
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
            if pid != 0:
                break
            if time.monotonic() - start > timeout and not timed_out:
                timed_out = True
                os.killpg(child.pid, signal.SIGKILL)
            time.sleep(0.005)
        child.returncode = os.waitstatus_to_exitcode(status)
        seconds = time.monotonic() - start
        out.seek(0)
        err.seek(0)
        errors = err.read().decode('utf-8', 'replace')
        return Run(command, own_status(child.returncode, errors), out.read().decode('utf-8', 'replace'), errors,
                   seconds, usage, timed_out)


class Lightmap:
    """One object's EXR: `irradiance` (height, width, 3), top row first, and all channels by name."""

    def __init__(self, path):
        self.path = path
        self.channels, self.attributes = read_exr(path)
        self.irradiance = np.stack([self.channels[c] for c in 'RGB'], -1).astype(np.float64)
        self.height, self.width = self.irradiance.shape[:2]

    def at(self, u, v):
        """Bilinear, as a sampler that clamps at the edge does it."""
        x = min(max(u * self.width - 0.5, 0.0), self.width - 1.0)
        y = min(max(v * self.height - 0.5, 0.0), self.height - 1.0)
        x0, y0 = int(x), int(y)
        x1, y1 = min(x0 + 1, self.width - 1), min(y0 + 1, self.height - 1)
        fx, fy = x - x0, y - y0
        e = self.irradiance
        return (e[y0, x0] * (1 - fx) + e[y0, x1] * fx) * (1 - fy) + (e[y1, x0] * (1 - fx) + e[y1, x1] * fx) * fy


def read_exr(path):
    """({channel: array (height, width)}, {attribute: value}) of an EXR's first part."""
    image = exr.read(path)
    return image.channels, image.attributes


class Points:
    """The surface points of kiln.h5, all arrays in the same order."""

    def __init__(self, path):
        with h5py.File(path, 'r') as f:
            get = lambda name: f[name][...]
            self.position = get('points/position').astype(np.float64)
            self.normal = get('points/normal').astype(np.float64)
            self.object = get('points/object').astype(np.int64)
            if 'points/texel' in f:
                self.x, self.y = get('points/texel').astype(np.int64).reshape(-1, 2).T
            else:  # of octrees
                self.leaf, self.facing = get('points/leaf').astype(np.int64), get('points/facing')
            self.side = get('points/side') if 'points/side' in f else np.zeros(len(self.object), np.uint8)
            self.part = get('points/part') if 'points/part' in f else np.zeros(len(self.object), np.uint8)
            self.area = get('points/area').astype(np.float64)
            self.valid = get('points/valid').astype(bool)
            self.direct = get('irradiance/direct').astype(np.float64)
            self.indirect = get('irradiance/indirect').astype(np.float64)
            self.total = get('irradiance/total').astype(np.float64)
            self.error = get('irradiance/error').astype(np.float64)
            # by name, of a bake with --ambient-occlusion or --directional
            self.quantities = {name: get(group + '/' + name).astype(np.float64)
                               for group in ('occlusion', 'directional') if group in f for name in f[group]}
        self.count = len(self.area)

    def of(self, index, side=0):
        """Indices of the valid points of object number `index` that its lightmap shows: of its fronts, or with side 1
        of its backs."""
        return np.flatnonzero((self.object == index) & (self.side == side) & (self.part == 0) & self.valid)


class Bake:
    """A finished bake's folder, read when asked."""

    def __init__(self, directory, process=None):
        self.directory, self.process = directory, process
        self._run = self._points = None
        self._lightmaps = {}

    @property
    def run(self):
        if self._run is None:
            self._run = run_json(self.directory)
        return self._run

    @property
    def points(self):
        if self._points is None:
            self._points = Points(os.path.join(self.directory, 'kiln.h5'))
        return self._points

    def names(self):
        return [o['name'] for o in self.run['objects']]

    def index(self, name):
        """Number of the object whose node is called `name`."""
        return self.names().index(name)

    def lightmap(self, name):
        if name not in self._lightmaps:
            entry = self.run['objects'][self.index(name)]
            self._lightmaps[name] = Lightmap(os.path.join(self.directory, entry['lightmap']))
        return self._lightmaps[name]

    def remove(self):
        shutil.rmtree(self.directory, ignore_errors=True)


class Kiln:
    """The program under test. `backend` traces the bakes' rays; sample counts are to be divided by `thin` (see
    `samples`)."""

    def __init__(self, path, scratch, backend='embree', thin=1):
        self.path, self.scratch, self.number, self.backend, self.thin = os.path.abspath(path), scratch, 0, backend, thin
        self.environment = dict(MPI_ENVIRONMENT)
        self.kernels = os.path.join(scratch, 'kernels')  # of bakes on devices: nothing is left in the user's folder
        if backend == 'vulkan':
            self.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')

    def samples(self, count):
        """What is left of a sample count: never below 16, where it was above."""
        return min(count, max(16, count // self.thin))

    @contextlib.contextmanager
    def under(self, **variables):
        """Runs within it have variables of the environment besides: coordinator/job/faults.h."""
        before = dict(self.environment)
        self.environment.update({name: str(value) for name, value in variables.items()})
        try:
            yield
        finally:
            self.environment.clear()
            self.environment.update(before)

    def command(self, *arguments, ranks=0, timeout=600):
        return run(under_mpi(ranks) + [self.path, *map(str, arguments)], timeout, self.environment)

    def bake(self, scene, *options, ranks=0, timeout=600):
        """Bakes into a fresh folder: under mpirun when `ranks` is given. Look at .process.status before anything
        else."""
        self.number += 1
        directory = os.path.join(self.scratch, 'bake%d' % self.number)
        command = [self.path, 'bake', scene, '-o', directory, '--quiet', '--no-preview', '--backend', self.backend,
                   *map(str, options)]
        if self.backend == 'vulkan':
            command += ['--kernel-cache', self.kernels]
        bake = Bake(directory, run(under_mpi(ranks) + command, timeout, self.environment))
        if bake.process.status == NO_DEVICE and self.number == 1:
            skip(bake.process.sentence())
        return bake


def energy(report):
    """(text, passed) of the energy balance of a run.json: what was emitted went somewhere, within 4 estimated errors or
    0.5 %. The sum is made here, from the ledger's parts; kiln's own residual must say the same."""
    e = report['energy']
    channels = lambda key: np.asarray(e[key], np.float64)
    emitted = channels('emitted')
    parts = ('absorbed', 'glass', 'gloss', 'escaped', 'blocked', 'ranged', 'unfound', 'left_over')
    gone = sum(channels(k) for k in parts)
    residual, power = float(LUMINANCE @ (emitted - gone)), float(LUMINANCE @ emitted)
    if not np.isfinite([residual, power, e['error']]).all():
        return 'not finite: %s' % json.dumps(e), False
    scale = power if power > 0 else 1.0
    text = '%+.1e of the power, error %.1e' % (residual / scale, e['error'] / scale)
    per_channel = np.abs(emitted - gone) <= np.maximum(4 * e['error'] / scale,
                                                       0.005) * np.where(emitted > 0, emitted, scale)
    own = abs(e['residual'] - residual) <= 1e-6 * scale
    return text, bool(abs(residual) <= max(4 * e['error'], 0.005 * power) and per_channel.all() and own)


class Checks:
    """Counts checks and prints those that fail, at once."""

    def __init__(self):
        self.passed = self.failed = 0

    def that(self, good, sentence, process=None):
        if good:
            self.passed += 1
            return True
        self.failed += 1
        print('FAILED: ' + sentence)
        if process is not None:
            print('   repeat: ' + process.line())
            if process.stderr.strip():
                print('   stderr: ' + '\n           '.join(process.stderr.strip().splitlines()[-8:]))
        sys.stdout.flush()
        return False

    def baked(self, bake):
        """The bake ended well and in time."""
        p = bake.process
        if p.timed_out:
            return self.that(False, 'the bake did not end in %.0f s' % p.seconds, p)
        if VALIDATION in p.stderr:
            return self.that(False, 'the Vulkan validation layer complains', p)
        if FALLBACK in p.stderr:
            return self.that(False, 'the device gave up and Embree took its place', p)
        return self.that(p.status == 0, 'the bake ended with %d instead of 0' % p.status, p)

    def energy(self, bake, what):
        text, good = energy(bake.run)
        self.that(good, '%s: energy is not kept: %s' % (what, text), bake.process)
        return text

    def end(self):
        print('%d checks passed, %d failed' % (self.passed, self.failed))
        sys.exit(1 if self.failed else 0)


class Table:
    """Columns of fixed width; a row is printed when it is known."""

    def __init__(self, *columns):
        self.columns = columns
        print(' '.join(('%-*s' if i == 0 else '%*s') % (w, n) for i, (n, w) in enumerate(columns)))
        print(' '.join('-' * w for _, w in columns), flush=True)

    def row(self, *cells):
        print(' '.join(('%-*s' if i == 0 else '%*s') % (w, c) for i,
                       ((_, w), c) in enumerate(zip(self.columns, cells))), flush=True)


def lightmap_hashes(bake):
    """{file: hash} of a bake's lightmaps."""
    found = {}
    for entry in bake.run['objects']:
        with open(os.path.join(bake.directory, entry['lightmap']), 'rb') as f:
            found[entry['lightmap']] = hashlib.sha256(f.read()).hexdigest()
    return found


def start(description, *more):
    """Parses --kiln, --keep, --backend, --thin and what `more` adds (callables on the parser); returns (arguments,
    Kiln). The scratch folder goes when the program ends, unless --keep."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument('--kiln', default=os.environ.get('KILN'), required='KILN' not in os.environ,
                        help='the program to test (the variable KILN)')
    parser.add_argument('--keep', metavar='DIR', help='bake into this folder and leave it there')
    parser.add_argument('--backend', choices=('embree', 'vulkan', 'auto'), default='embree',
                        help='what traces the rays')
    parser.add_argument('--thin', metavar='N', type=int, default=1,
                        help='sample counts are divided by N: for slow devices')
    for add in more:
        add(parser)
    arguments = parser.parse_args()
    if not os.access(arguments.kiln, os.X_OK):
        sys.exit('%s is not a program: build it first' % arguments.kiln)
    if arguments.keep:
        os.makedirs(arguments.keep, exist_ok=True)
        scratch = arguments.keep
    else:
        scratch = tempfile.mkdtemp(prefix='kiln-test-')
        import atexit
        atexit.register(shutil.rmtree, scratch, ignore_errors=True)
    return arguments, Kiln(arguments.kiln, scratch, arguments.backend, arguments.thin)
