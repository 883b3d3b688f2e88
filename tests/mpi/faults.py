#!/usr/bin/env python3
"""A rank of a bake fails where it may: an allocation, shared memory, a file, a thread. Or it goes astray, or to sleep.
All ranks end, soon, with a sentence.

    faults.py --kiln PATH some   KILN_FAULTS places (10) drawn from KILN_SEED; ranks that wait for each other; one that
                                 sleeps
    faults.py --kiln PATH all    every place of every rank, or with KILN_STRIDE=N every Nth; not a test
    faults.py --kiln PATH differ ranks with different options, scenes, programs, commands
    faults.py --kiln PATH shm    no /dev/shm (as root)

Of every run: the bake ends within 30 s, with the fault's own code or 76 and one sentence that names rank and host, or
with 0 and the same bits; nothing is left in /dev/shm or TMPDIR. A fault is what tests/mpi/faults.c says.
"""
import os
import random
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

SENTENCE = re.compile(r'^kiln: error: (.*)$', re.M)
OWN_CODES = {'allocation': {71}, 'window': {71}, 'thread': {71}, 'file': {66, 71, 73, 74, 77}}
SECONDS = 30
SETTINGS = ['--quality', 'draft', '--texels-per-metre', '2', '--bounces', '2', '--threads', '2', '--quiet']


class Bakes:
    def __init__(self, tool, scratch):
        self.tool, self.scratch, self.count = tool, scratch, 0
        self.faults = os.path.join(os.path.dirname(tool), 'tests', 'libkiln_faults.so')
        if not os.path.exists(self.faults):
            sys.exit('there is no %s: build the tests' % self.faults)
        self.scene = os.path.join(scratch, 'scene.glb')
        subprocess.run([tool, 'generate', 'cornell', '-o', self.scene], check=True, stdout=subprocess.DEVNULL)

    def folder(self):
        self.count += 1
        return os.path.join(self.scratch, str(self.count))

    def run(self, folder, ranks, *more, fault=None, counts=None):
        """Exit code (None: killed after SECONDS), stderr, seconds, and what is left in TMPDIR and /dev/shm."""
        temporary = tempfile.mkdtemp(dir='/tmp')  # short: Open MPI makes sockets there
        environment = {**os.environ, **harness.MPI_ENVIRONMENT, 'TMPDIR': temporary}
        before = set(os.listdir('/dev/shm'))
        command = ['mpirun', '-n', str(ranks)]
        if fault or counts:
            command += ['-x', 'LD_PRELOAD=' + self.faults]
        environment.update({'KILN_FAULT': fault} if fault else {}, **({'KILN_FAULT_COUNTS': counts} if counts else {}))
        began = time.time()
        process = subprocess.Popen(command + [self.tool, 'bake', self.scene, '-o', folder] + SETTINGS + list(more),
                                   env=environment, stdin=subprocess.DEVNULL,
                                   stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)
        try:
            errors = process.communicate(timeout=SECONDS)[1].decode(errors='replace')
            status = process.returncode
        except subprocess.TimeoutExpired:
            process.terminate()
            errors, status = process.communicate()[1].decode(errors='replace'), None
        seconds = time.time() - began
        left = [os.path.join(root, name) for root, folders, files in os.walk(temporary) for name in files]
        left += ['/dev/shm/' + name for name in set(os.listdir('/dev/shm')) - before if self.is_ours(name)]
        shutil.rmtree(temporary, ignore_errors=True)
        return status, errors, seconds, left

    def is_ours(self, name):
        """Other tests may run: their shared memory is in use."""
        path = os.path.join('/dev/shm', name)
        in_use = subprocess.run(['grep', '-lqs', path, *('/proc/%s/maps' % pid for pid in os.listdir('/proc')
                                                         if pid.isdigit())], check=False).returncode
        return os.path.exists(path) and in_use != 0


def results(folder):
    names = ['kiln.h5', 'volume.hdf'] + sorted('lightmaps/' + n for n in os.listdir(os.path.join(folder, 'lightmaps')))
    return [open(os.path.join(folder, n), 'rb').read() for n in names if os.path.isfile(os.path.join(folder, n))]


def judge(bakes, reference, ranks, fault, *more):
    """What is wrong with how a bake takes a fault; None: nothing. And its exit code."""
    folder = bakes.folder()
    status, errors, seconds, left = bakes.run(folder, ranks, *more, fault=fault)
    rank, kind = fault.split(':')[:2]
    said = SENTENCE.findall(errors)
    problem = None
    if status is None:
        problem = 'still there after %d s' % SECONDS
    elif left:
        problem = 'left: %s' % ' '.join(left)
    elif status == 0:
        if results(folder) != reference:
            problem = 'ended with 0 and other results'
    elif kind == 'thread' and status == 1 and 'pmix_init failed' in errors:
        pass  # Open MPI's own end, before MPI_Init returns
    elif status != 76 and status not in OWN_CODES.get(kind, ()):
        problem = 'ended with %d: %s' % (status, errors[-600:])
    elif len(said) != 1:
        problem = '%d sentences, not one: %s' % (len(said), errors[-600:])
    elif 'rank %s on %s' % (rank, socket.gethostname()) not in said[0]:
        problem = 'no rank and host in: %s' % said[0]
    shutil.rmtree(folder, ignore_errors=True)
    return problem, status, seconds


def count_calls(bakes, ranks):
    """Results of a bake without a fault, and how many calls of each kind each rank made."""
    folder, counts = bakes.folder(), tempfile.mkdtemp(dir=bakes.scratch)
    status, errors, _, _ = bakes.run(folder, ranks, counts=counts)
    if status != 0:
        sys.exit('a bake without a fault ended with %s: %s' % (status, errors))
    calls = {}
    for rank in range(ranks):
        for line in open(os.path.join(counts, str(rank))):
            kind, count = line.split()
            calls[kind, rank] = int(count)
    return results(folder), calls


def try_places(checks, bakes, ranks, places, reference):
    codes, longest = {}, 0.0
    for kind, rank, at in places:
        fault = '%d:%s:%d' % (rank, kind, at)
        problem, status, seconds = judge(bakes, reference, ranks, fault)
        checks.that(problem is None, 'KILN_FAULT=%s on %d ranks: %s' % (fault, ranks, problem))
        codes.setdefault(kind, {}).setdefault(status, 0)
        codes[kind][status] += 1
        longest = max(longest, seconds)
    for kind in sorted(codes):
        print('%s: %s' %
              (kind, ', '.join('%d ended with %s' % (n, c) for c, n in sorted(codes[kind].items(), key=str))))
    print('the longest took %.1f s' % longest)


def try_some(checks, bakes):
    seed = int(os.environ.get('KILN_SEED', random.SystemRandom().randrange(1 << 30)))
    print('KILN_SEED=%d' % seed)
    dice, ranks = random.Random(seed), 2
    reference, calls = count_calls(bakes, ranks)
    places = []
    for i in range(int(os.environ.get('KILN_FAULTS', 10))):
        kind = ('allocation', 'file', 'window', 'allocation', 'file', 'thread')[i % 6]
        rank = dice.randrange(ranks)
        if calls[kind, rank] > 0:
            places.append((kind, rank, dice.randrange(calls[kind, rank]) + 1))
    try_places(checks, bakes, ranks, places, reference)
    for kind, words in (('astray', 'wait for each other'), ('asleep', 'neither computed nor read')):
        place = '1:%s:%d' % (kind, calls['allocation', 1] // 12)
        status, errors, seconds, left = bakes.run(bakes.folder(), 2, '--watchdog', '4', fault=place)
        print('%s: %.1f s, %s' % (kind, seconds, ' '.join(SENTENCE.findall(errors))))
        checks.that(status == 76 and words in errors and 'rank 1 on ' + socket.gethostname() in errors and not left,
                    'KILN_FAULT=%s --watchdog 4: ended with %s, left %s: %s' % (place, status, left, errors[-800:]))


def try_all(checks, bakes):
    ranks, stride = int(os.environ.get('KILN_RANKS', 2)), int(os.environ.get('KILN_STRIDE', 1))
    reference, calls = count_calls(bakes, ranks)
    print(calls)
    kinds = os.environ.get('KILN_KINDS', 'window,thread,file,allocation').split(',')
    for kind in kinds:
        for rank in range(ranks):
            places = [(kind, rank, at)
                      for at in range(1 + (stride // 2 if stride > 1 else 0), calls[kind, rank] + 1, stride)]
            print('rank %d, %d of %d places of kind %s' % (rank, len(places), calls[kind, rank], kind), flush=True)
            try_places(checks, bakes, ranks, places, reference)


def try_differ(checks, bakes):
    other = os.path.join(bakes.scratch, 'other.glb')
    subprocess.run([bakes.tool, 'generate', 'furnace', '-o', other], check=True, stdout=subprocess.DEVNULL)
    copy = os.path.join(bakes.scratch, 'kiln')
    with open(bakes.tool, 'rb') as source, open(copy, 'wb') as target:  # another build: a byte more
        target.write(source.read() + b'\0')
    os.chmod(copy, 0o755)
    yaml = os.path.join(bakes.scratch, 'job.yaml')
    with open(yaml, 'w') as file:
        file.write('scene: %s\ncell-size: 0.7\n' % bakes.scene)
    out = bakes.folder()
    bake = [bakes.tool, 'bake', bakes.scene, '-o', out, '--watchdog', '10'] + SETTINGS
    cases = [
        ('an option', bake + ['--seed', '4'], 64, ['rank 1 on', '--seed', "'4'", "'0'"]),
        ('a switch', bake + ['--no-preview'], 64, ['rank 1 on', '--preview', "'off'"]),
        ('a job file', [bakes.tool, 'bake', yaml, '-o', out, '--watchdog', '10'] + SETTINGS, 64,
         ['rank 1 on', '--cell-size', "'0.69999999999999996'"]),
        ('a folder', [bakes.tool, 'bake', bakes.scene, '-o', out + 'x'] + SETTINGS, 64, ['rank 1 on', '--output']),
        ('a scene', [bakes.tool, 'bake', other, '-o', out] + SETTINGS, 64, ['rank 1 on', 'scene', 'other.glb']),
        ('a build', [copy] + bake[1:], 64, ['rank 1 on', 'build']),
        ('a command', [bakes.tool, 'info', bakes.scene], 64, ['rank 1 on', 'command', "'info'", "'bake'"]),
        # at the deadline of the start
        ('help, which starts no MPI', [bakes.tool, '--help'], 76, ['rank 0 on', 'have not all started']),
        ('a slip', bake + ['--bunces', '3'], 64, ['--bunces']),
        ('threads', bake + ['--threads', '1'], 0, []),
    ]
    environment = {**os.environ, **harness.MPI_ENVIRONMENT}
    for what, second, wanted, words in cases:
        first = bake + (['--watchdog', '3'] if second[-1] == '--help' else [])  # which waits for its end
        try:
            done = subprocess.run(['mpirun', '-n', '1'] + first + [':', '-n', '1'] + second, env=environment,
                                  capture_output=True, text=True, timeout=60, check=False)
        except subprocess.TimeoutExpired:
            checks.that(False, 'another rank was given %s: nothing for 60 s' % what)
            continue
        said = SENTENCE.findall(done.stderr)
        if wanted == 76 and done.returncode == 1 and 'exiting improperly' in done.stderr:
            print('mpirun saw that a rank ended without MPI before the other one could say so')
            continue
        checks.that(done.returncode == wanted and len(said) == (wanted != 0) and all(w in done.stderr for w in words),
                    'another rank was given %s: ended with %d: %s' % (what, done.returncode, done.stderr[-600:]))
    print('%d pairs of ranks that were given different things' % len(cases))


def try_shm(checks, bakes):
    if os.geteuid() != 0 or subprocess.run(['unshare', '-m', 'true'], check=False).returncode != 0:
        harness.skip('mounting needs root')
    reference, _ = count_calls(bakes, 2)
    for what, mount in (('read-only', 'mount -t tmpfs -o ro tmpfs /dev/shm'),
                        ('of 64 KiB', 'mount -t tmpfs -o size=64k tmpfs /dev/shm'),
                        ('missing', 'mount -t tmpfs -o ro tmpfs /dev')):
        folder = bakes.folder()
        if what == 'missing':  # a /dev with little in it
            mount = 'for f in null zero urandom random tty; do touch %s/$f; done; ' % bakes.scratch
            mount += 'mkdir -p {0}/d/pts && for f in null zero urandom random; do cp -a /dev/$f {0}/d/; done && ' \
                     'ln -s /proc/self/fd {0}/d/fd && ln -s pts/ptmx {0}/d/ptmx && ' \
                     'mount --bind /dev/pts {0}/d/pts && mount --rbind {0}/d /dev'.format(bakes.scratch)
        line = ['mpirun', '-n', '2', bakes.tool, 'bake', bakes.scene, '-o', folder] + SETTINGS
        try:
            done = subprocess.run(['unshare', '-m', 'sh', '-c', mount + ' && exec "$@"', 'sh'] + line,
                                  env={**os.environ, **harness.MPI_ENVIRONMENT},
                                  capture_output=True, text=True, timeout=120, check=False)
        except subprocess.TimeoutExpired:
            checks.that(False, '/dev/shm %s: nothing for 120 s' % what)
            continue
        good = done.returncode == 0 and results(folder) == reference
        checks.that(good, '/dev/shm %s: ended with %d: %s' % (what, done.returncode, done.stderr[-900:]))
        print('/dev/shm %s: %d' % (what, done.returncode))


PARTS = {'some': try_some, 'all': try_all, 'differ': try_differ, 'shm': try_shm}


def main():
    arguments, kiln = harness.start(__doc__, lambda parser: parser.add_argument('part', choices=sorted(PARTS)))
    checks = harness.Checks()
    PARTS[arguments.part](checks, Bakes(os.path.abspath(kiln.path), kiln.scratch))
    checks.end()


if __name__ == '__main__':
    main()
