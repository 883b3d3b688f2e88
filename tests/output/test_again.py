"""Every command that writes files is killed, stopped and left without room on its disk; the same command again ends as
if nothing had happened, with the same bits. A command that is stopped, or has no room, leaves no temporary file and no
lock. What is somebody else's in a folder stays. KILN_SEED."""
import contextlib
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '../cli'))
sys.path.insert(0, os.path.join(HERE, '../common'))
import glb  # noqa: E402
import harness  # noqa: E402
import price  # noqa: E402
from kiln_cli import KILN, kiln  # noqa: E402

SEED = int(os.environ.get('KILN_SEED', '1'))
USAGE, CANNOT_CREATE, IO, STOPPED = 64, 73, 74, 75
BAKE = ('--texels-per-metre', 6, '--backend', 'embree', '--threads', 1, '--samples-direct', 8, '--samples-bounce', 4,
        '--samples-indirect', 16, '--samples-probe', 4, '--probe-spacing', 1, '--materials', 'diffuse', '--no-preview')
VIEW = ('--width', 24, '--height', 16, '--backend', 'embree', '--threads', 1)
# These say when they were made and how long that took.
TIMES = ('run.json', 'manifest', 'kiln.h5', 'index', 'converge.csv', 'converge.svg', 'scaling.csv',
         'scaling.svg', 'states.json')
LOCK = '.kiln.lock'


def room(path):
    scene = glb.Scene()
    wall = scene.material('wall', (0.7, 0.7, 0.6))
    for i in range(4):
        glb.box(scene, f'room{i}', (3 * i, 0, 0), (3 * i + 2, 2, 2), wall, inward=range(6))
        scene.light(f'lamp{i}', {'type': 'point', 'intensity': 3.0}, translation=[3 * i + 0.6, 1.7, 1.5])
    return scene.write(path)


def files_of(folder):
    return sorted(os.path.relpath(os.path.join(place, name), folder)
                  for place, _, names in os.walk(folder) for name in names)


def content(folder):
    """Names of all files, with the hash of each that has no times in it."""
    found = {}
    for name in files_of(folder):
        with open(os.path.join(folder, name), 'rb') as file:
            found[name] = None if os.path.basename(name) in TIMES else hashlib.sha256(file.read()).hexdigest()
    return found


def left_behind(folder):
    return [name for name in files_of(folder) if name.endswith('.part') or os.path.basename(name).startswith(LOCK)]


class Again(unittest.TestCase):
    kills, stops, sizes = (20, 10, 8) if price.full else (1, 1, 1)
    references = {}

    @classmethod
    def setUpClass(cls):
        cls.chance = random.Random(SEED)
        print(f'KILN_SEED={SEED}')
        cls.folder = tempfile.mkdtemp(prefix='kiln-again-')
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.scene, cls.baked = cls.path('room.glb'), cls.path('baked')
        room(cls.scene)
        groups, cls.states, cls.keys = cls.path('groups.yaml'), cls.path('states.yaml'), cls.path('keys.csv')
        for path, text in ((groups, 'first: {lights: [lamp0]}\n'),
                           (cls.states, 'dim: {lights: {"*": {scale: 0.5}}}\ndark: {lights: {"*": {on: false}}}\n'),
                           (cls.path('street.yaml'), 'parts:\n- {name: a, file: room.glb}\n'
                                                     '- {name: b, file: room.glb, at: {translation: [20, 0, 0]}}\n'),
                           (cls.keys, 'from.x,from.y,from.z,to.x,to.y,to.z\n0.3,1,1,1.5,1,1\n1.5,1,1,0.3,1,1\n')):
            with open(path, 'w', encoding='utf-8') as file:
                file.write(text)
        for name, more in (('baked', ()), ('grouped', ('--light-groups', groups))):
            answer = kiln('bake', cls.scene, *BAKE, '--keep-transport', 'rows', *more, '-o', cls.path(name),
                          timeout=120)
            assert answer.code == 0, answer.err

    @classmethod
    def path(cls, *names):
        return os.path.join(cls.folder, *names)

    def commands(self):
        """Each command that writes, as words of the folder that it writes to."""
        return {
            'bake': lambda out: ('bake', self.scene, *BAKE, '-o', out),
            'relight': lambda out: ('relight', self.baked, '--no-preview', '-o', out),
            'states': lambda out: ('relight', self.baked, '--states', self.states, '--no-preview', '-o', out),
            'mix': lambda out: ('mix', self.path('grouped'), '--set', 'first=0.5', '-o', out),
            'export': lambda out: ('export', self.baked, '-o', os.path.join(out, 'scene.glb')),
            'path': lambda out: ('view', self.baked, *VIEW, '--path', self.keys, '--frames', 6, '-o',
                                 os.path.join(out, 'frame.exr')),
            'traced': lambda out: ('view', self.scene, *VIEW, '--method', 'path', '--samples-pixel', 4, '--path',
                                   self.keys, '--frames', 4, '-o', os.path.join(out, 'frame.png')),
            'report': lambda out: ('report', self.baked, '-o', os.path.join(out, 'report.html')),
            'plan': lambda out: ('plan', self.scene, *BAKE[:4], '--ranks', 2, '-o', out),
            'generate': lambda out: ('generate', 'city', '--triangles', 20000, '-o', os.path.join(out, 'city.glb')),
            'import': lambda out: ('import', self.path('street.yaml'), *BAKE[:2], '-o', out),
            'parts': lambda out: ('bake', self.path('street.yaml'), *BAKE, '-o', out),
            'bench': lambda out: ('bench', 'converge', self.scene, 'path', *VIEW, '--doublings', 1,
                                  '--reference-samples', 4, '--from', '0.3,1,1', '--to', '1.5,1,1', '-o', out),
        }

    def start(self, words):
        return subprocess.Popen([KILN, *map(str, words)], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                stderr=subprocess.PIPE, text=True)

    def reference(self, name):
        """What the command writes when nobody disturbs it, and how long that takes."""
        if name in self.references:
            return self.references[name]
        out = self.path(name + '-reference')
        os.mkdir(out)
        begin = time.monotonic()
        self.run_to_end(name, out)
        self.references[name] = content(out), time.monotonic() - begin
        return self.references[name]

    def run_to_end(self, name, out):
        answer = kiln(*self.commands()[name](out), timeout=120)
        self.assertEqual(answer.code, 0, f'{name}: {answer.err}')
        self.assertEqual(left_behind(out), [], name)

    def wait_for_a_file(self, process, out, seconds):
        """Half of the signals come when the first file is there, or its temporary one, and a little later."""
        before, end = set(files_of(out)), time.monotonic() + seconds
        while time.monotonic() < end and process.poll() is None and set(files_of(out)) == before:
            time.sleep(0.001)
        time.sleep(self.chance.random() * 0.03)

    def disturb(self, name, out, seconds, number):
        before = left_behind(out) # of those that were killed
        process = self.start(self.commands()[name](out))
        if self.chance.random() < 0.5:
            self.wait_for_a_file(process, out, seconds)
        else:
            time.sleep(self.chance.uniform(0.1, 1.0) * seconds)
        process.send_signal(number)
        said = process.communicate(timeout=60)[1]
        if number == signal.SIGKILL:
            return
        # what comes before kiln has begun, or after it has ended, ends it as any process
        self.assertIn(process.returncode, (0, STOPPED, -number), f'{name}: {said}')
        self.assertLessEqual(set(left_behind(out)), set(before), f'{name} and signal {number}: {said}')
        if process.returncode == STOPPED:
            self.assertRegex(said, 'stopped by SIG|stopped by [A-Z]')

    def check_signals(self, name):
        wanted, seconds = self.reference(name)
        out = self.path(name)
        os.mkdir(out)
        numbers = [signal.SIGKILL] * self.kills
        numbers += [self.chance.choice((signal.SIGTERM, signal.SIGINT, signal.SIGHUP)) for _ in range(self.stops)]
        for number in numbers:
            self.disturb(name, out, seconds, number)
            if price.full and self.chance.random() < 0.3: # also one kill by itself, and over whole results
                self.run_to_end(name, out)
        self.run_to_end(name, out)
        self.assertEqual(content(out), wanted, name)

    @contextlib.contextmanager
    def disk(self, size):
        mount = tempfile.mkdtemp(dir=self.folder)
        if subprocess.run(['mount', '-t', 'tmpfs', '-o', f'size={size}k', 'none', mount],
                          capture_output=True).returncode != 0:
            self.skipTest('only root mounts a small disk')
        try:
            yield mount
        finally:
            subprocess.run(['umount', '-l', mount], check=True)

    def check_disk(self, name):
        wanted, _ = self.reference(name)
        whole = self.path(name + '-reference')
        size = sum(4 * -(-os.path.getsize(os.path.join(whole, file)) // 4096) for file in wanted) # kB, in whole pages
        refused = 0
        for i in range(self.sizes):
            with self.disk(max(4, int(size * (i + 0.5) / self.sizes))) as mount:
                out = os.path.join(mount, 'out')
                os.mkdir(out)
                answer = kiln(*self.commands()[name](out), timeout=120)
                refused += answer.code != 0
                self.assertIn(answer.code, (0, CANNOT_CREATE, IO), f'{name}, {size} kB: {answer.err}')
                self.assertEqual(left_behind(out), [], f'{name}: {answer.err}')
                subprocess.run(['mount', '-o', 'remount,size=64m', mount], check=True)
                self.run_to_end(name, out)
                self.assertEqual(content(out), wanted, name)
        self.assertGreater(refused, 0, name)

    def test_owner(self):
        """A folder with files of somebody else, or of another command, is refused, and nothing in it is changed."""
        mine, mixed = self.path('mine'), self.path('mixed')
        os.makedirs(os.path.join(mine, 'trial'))
        with open(os.path.join(mine, 'trial', 'precious'), 'w') as file:
            file.write('mine')
        before = content(mine)
        for name in ('mix', 'bench'):
            answer = kiln(*self.commands()[name](mine), timeout=120)
            self.assertEqual(answer.code, USAGE, answer.err)
            self.assertIn('has other files in it', answer.sentence())
            self.assertEqual(content(mine), before)
        self.run_to_end('mix', mixed)
        self.run_to_end('mix', mixed)  # whole results may be replaced
        answer = kiln(*self.commands()['bench'](mixed), timeout=120)
        self.assertEqual(answer.code, USAGE, answer.err)
        with open(os.path.join(mixed, '.kiln.unfinished'), 'w') as file:
            file.write('kiln mix\n')
        answer = kiln(*self.commands()['bench'](mixed), timeout=120)
        self.assertEqual(answer.code, USAGE, answer.err)
        self.assertIn("has files of 'kiln mix'", answer.sentence())
        self.run_to_end('bake', mixed)  # a bake's files are no mixture's to replace
        answer = kiln(*self.commands()['mix'](mixed), timeout=120)
        self.assertEqual(answer.code, USAGE, answer.err)

    def test_two_at_a_time(self):
        """While one mixes, another is refused."""
        out = self.path('busy')
        first = subprocess.Popen([KILN, *map(str, self.commands()['mix'](out))], stdout=subprocess.DEVNULL)
        while not os.path.exists(os.path.join(out, LOCK)):
            self.assertIsNone(first.poll(), 'it was too quick')
            time.sleep(0.0005)
        first.send_signal(signal.SIGSTOP)
        answer = kiln(*self.commands()['mix'](out), timeout=120)
        first.send_signal(signal.SIGCONT)
        self.assertEqual(first.wait(60), 0)
        self.assertEqual(answer.code, CANNOT_CREATE, answer.err)
        self.assertIn('at work', answer.sentence())

    def test_ranks(self):
        """Of several ranks each removes what it has begun."""
        # mpirun kills ranks for good a second after it has asked them to end, which on a busy machine is too soon
        patient = {'OMPI_MCA_odls_base_sigkill_timeout': '30'}
        out, environment = self.path('ranks'), dict(os.environ, **harness.MPI_ENVIRONMENT, **patient)
        words = ['mpirun', '--bind-to', 'none', '-n', '2', KILN, *map(str, self.commands()['mix'](out))]
        for number in (signal.SIGTERM, signal.SIGINT):
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                                       stderr=subprocess.PIPE, text=True, env=environment)
            while not os.path.exists(os.path.join(out, LOCK)):
                self.assertIsNone(process.poll(), 'it was too quick')
                time.sleep(0.001)
            process.send_signal(number)
            said = process.communicate(timeout=60)[1]
            end = time.monotonic() + 20  # mpirun may end before its ranks
            while left_behind(out) and time.monotonic() < end:
                time.sleep(0.02)
            self.assertEqual(left_behind(out), [], said)
        done = subprocess.run(words, capture_output=True, text=True, env=environment, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(content(out), self.reference('mix')[0])

    def test_refused(self):
        """A bake that is refused after its scene was imported leaves the folder as it was."""
        answer = kiln('bake', self.scene, *BAKE, '--probe-spacing', 0.0005, '-o', self.path('refused'), timeout=120)
        self.assertNotEqual(answer.code, 0)
        self.assertFalse(os.path.exists(self.path('refused')), files_of(self.path('refused')))
        out = self.path('refused-there')
        os.mkdir(out)
        with open(os.path.join(out, 'note'), 'w') as file:
            file.write('mine')
        answer = kiln('bake', self.scene, *BAKE, '--probe-spacing', 0.0005, '-o', out, timeout=120)
        self.assertNotEqual(answer.code, 0)
        self.assertEqual(files_of(out), ['note'])
        os.remove(os.path.join(out, 'note'))
        self.run_to_end('bake', out)  # whose scene stays that of its manifest
        before = content(out)
        other = self.path('other.glb')
        self.assertEqual(kiln('generate', 'furnace', '-o', other).code, 0)
        answer = kiln('bake', other, *BAKE, '--probe-spacing', 0.0005, '-o', out, timeout=120)
        self.assertNotEqual(answer.code, 0)
        self.assertEqual(content(out), before)
        answer = kiln('verify', out)
        self.assertEqual(answer.code, 0, answer.err)
        answer = kiln('bake', other, *BAKE, '-o', out, timeout=120)
        self.assertEqual(answer.code, 0, answer.err)
        self.assertEqual([name for name in files_of(out) if name.startswith('.')], [])


def add_tests():
    for name in ('bake', 'relight', 'states', 'mix', 'export', 'path', 'traced', 'report', 'plan', 'generate',
                 'import', 'parts', 'bench'):
        for kind in ('signals', 'disk'):
            def test(self, name=name, check='check_' + kind):
                getattr(self, check)(name)
            setattr(Again, f'test_{kind}_{name}', test)


add_tests()

if __name__ == '__main__':
    unittest.main(verbosity=1)
