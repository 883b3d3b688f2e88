"""A bake that is interrupted, in every way there is, goes on to the same bits.

    resume.py --kiln PATH kills       kill -9 a random rank of three at random moments, a part of them while a
                                      checkpoint, lightmaps in bands or other results are written (KILN_KILLS of them,
                                      KILN_SEED; with --full 200, in three scenes; with KILN_LOCAL=FOLDER by
                                      --checkpoint-local)
    resume.py --kiln PATH local       kill -9 with --checkpoint-local: what was not copied comes from the nodes, and a
                                      lost node does no harm
    resume.py --kiln PATH ends        kill -9 a rank when the job is about to end (KILN_ENDS times, KILN_SEED), and
                                      mpirun itself
    resume.py --kiln PATH layouts     go on with other numbers of ranks and threads
    resume.py --kiln PATH quantities  kill -9 within ambient occlusion and light by direction
    resume.py --kiln PATH blocks      kill -9 within a bounce at a quarter of the resolution, and a gather by nodes
    resume.py --kiln PATH caustics    kill -9 within caustics and the gather after them
    resume.py --kiln PATH landing     kill -9 while light paths land in texels
    resume.py --kiln PATH sharing     kill -9 while light paths and gather rays share caustics
    resume.py --kiln PATH growing     kill -9 while light paths of a later round of --iterations all land
    resume.py --kiln PATH crossing    kill -9 while light paths cross the spheres of probes
    resume.py --kiln PATH paths       kill -9 a random rank of 1, 2, 3, 5, 8, by turns, at random moments of bakes with
                                      light paths (KILN_KILLS of each of land and vcm, KILN_SEED)
    resume.py --kiln PATH bounces     hundreds of bounces, stopped and gone on with after the 256th
    resume.py --kiln PATH signals     SIGUSR1, SIGTERM, SIGINT, kiln stop, --max-time: 75, and what kiln status says
    resume.py --kiln PATH phases      a signal to one of two ranks in every phase (without --full: in some): 75
                                      within 5 s
    resume.py --kiln PATH refusals    another scene or setting is refused, with a table
    resume.py --kiln PATH damage      flipped bits, cut and missing files: noticed, the generation before is used
                                      (KILN_FLIPS, KILN_SEED)
    resume.py --kiln PATH disk        full disk 74, read-only folder 73 or 77, last generation whole
    resume.py --kiln PATH faults      the k-th write, sync, rename or open fails (KILN_FAULTS of them, KILN_SEED; needs
                                      strace, not a test)
    resume.py --kiln PATH interrupted the k-th one fails with EINTR, which does no harm (the same)
    resume.py --kiln PATH warnings    SIGUSR1 through mpirun at random moments (KILN_WARNINGS of them, KILN_SEED; not a
                                      test)
    resume.py --kiln PATH watchdog    a rank that stands still is named, 76
    resume.py --kiln PATH halts       SIGSTOP to a random rank at random moments (KILN_HALTS of them, KILN_SEED; not a
                                      test)
    resume.py --kiln PATH cost        what checkpoints cost (a measurement)
"""
import collections
import glob
import hashlib
import itertools
import json
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import time

import h5py
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path.insert(0, os.path.join(HERE, '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402
from reading import run_json  # noqa: E402

STOPPED, LOST, BAD_INPUT, SYSTEM, CANNOT_CREATE, IO, PERMISSION = 75, 76, 65, 71, 73, 74, 77
SCENE = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
# A few seconds on two cores, in enough batches that there is something to interrupt.
OPTIONS = ('--backend', 'embree', '--lightmap-size', '48', '--samples-direct', '64', '--samples-bounce', '32',
           '--samples-indirect', '256', '--bounces', '4',
           '--samples-probe', '64', '--error-map')
PROBES = ('--samples-probe', '2048')
OFTEN = ('--checkpoint-every', '0.05')
LOOK = 0.02  # seconds between two looks at all processes, which take milliseconds
# With so many samples that their steps last long enough to be interrupted.
QUANTITIES = ('--ambient-occlusion', '0.5', '--directional', 'sh1', '--samples-indirect', '2048', '--lightmap-size',
              '24')


class Tool:
    def __init__(self, kiln, scratch, full=False):
        self.kiln, self.scratch, self.number, self.full = kiln, scratch, 0, full

    def folder(self):
        self.number += 1
        return os.path.join(self.scratch, 'bake%d' % self.number)

    def line(self, folder, *more, ranks=0, threads=1, scene=SCENE):
        command = [self.kiln, 'bake', scene, '-o', folder, '--no-preview', '--threads', str(threads), *OPTIONS,
                   *map(str, more)]
        if os.environ.get('KILN_LOCAL'):
            command += ['--checkpoint-local', os.environ['KILN_LOCAL']]
        return (['mpirun', '--bind-to', 'none', '-n', str(ranks)] if ranks else []) + command

    def start(self, folder, *more, log=None, private=False, halt='', **how):
        """Runs in the background; what it prints goes to LOG.out and LOG.err (LOG: the folder's name). private:
        FOLDER.tmp is its TMPDIR. halt: RANK:PLACE, where that rank stops itself."""
        log = log or folder
        env = dict(os.environ)
        env.update(harness.MPI_ENVIRONMENT)
        if halt:
            env['KILN_HALT_RANK'] = halt
        if private:
            os.makedirs(folder + '.tmp', exist_ok=True)
            env['TMPDIR'] = folder + '.tmp'
        with open(log + '.out', 'wb') as out, open(log + '.err', 'wb') as err:
            return subprocess.Popen(self.line(folder, *more, **how), stdout=out, stderr=err, stdin=subprocess.DEVNULL,
                                    env=env, start_new_session=True)

    def bake(self, folder, *more, timeout=120, **how):
        return harness.run(self.line(folder, *more, **how), timeout, harness.MPI_ENVIRONMENT)

    def run(self, *arguments):
        return harness.run([self.kiln, *arguments], 60, harness.MPI_ENVIRONMENT)


def finish(process, timeout=60):
    try:
        return process.wait(timeout)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return None


def text(folder, end='.err'):
    with open(folder + end, errors='replace') as f:
        return f.read()


def ranks_of(process):
    """Process numbers of the kiln ranks below a process, or itself."""
    found = []
    for path in glob.glob('/proc/[0-9]*/stat'):
        try:
            pid = int(path.split('/')[2])
            with open(path) as f:
                parent = int(f.read().rsplit(')', 1)[1].split()[1])
            if process.pid not in (pid, parent):
                continue
            with open(path[:-4] + 'cmdline', 'rb') as f:
                words = f.read().split(b'\0')
        except OSError:
            continue
        if os.path.basename(words[0]).startswith(b'kiln') and words[1:2] == [b'bake']:
            found.append(pid)
    return sorted(found)


def state_of(pid):
    """R, S, D, T (stopped), Z as in /proc; Z too when it is gone."""
    try:
        with open('/proc/%s/stat' % pid) as f:
            return f.read().rsplit(')', 1)[1].split()[0]
    except OSError:
        return 'Z'


def threads_of(pid):
    try:
        return os.listdir('/proc/%d/task' % pid)
    except OSError:
        return []


def digest(values):
    return hashlib.sha256(np.ascontiguousarray(values).tobytes()).hexdigest()


def result(folder):
    """{file or dataset: hash} of all that a bake leaves; what differs with the number of ranks is left out."""
    found = {}
    for path in sorted(glob.glob(os.path.join(folder, 'lightmaps', '**', '*.exr'), recursive=True)):
        with open(path, 'rb') as f:
            found[os.path.relpath(path, folder)] = hashlib.sha256(f.read()).hexdigest()
    for name in ('kiln.h5', 'volume.hdf'):
        with h5py.File(os.path.join(folder, name), 'r') as f:
            def visit(key, item, name=name):
                if isinstance(item, h5py.Dataset) and not key.startswith(('timings', 'run')):
                    found['%s %s' % (name, key)] = digest(item[...])
            f.visititems(visit)
    run = run_json(folder)
    found['energy'] = json.dumps(run['energy'])
    found['passes'] = json.dumps([[b['kind'], b['samples'], b['incident']] for b in run['bounces']])
    found['rays'] = json.dumps(run['rays'])
    return found


def differences(a, b):
    return ', '.join(sorted(k for k in set(a) | set(b) if a.get(k) != b.get(k)))[:300]


def readable(folder):
    """What in the folder cannot be read as what its name says, as sentences."""
    bad = []
    for path in glob.glob(os.path.join(folder, '**'), recursive=True):
        name = os.path.basename(path)
        try:
            if name.endswith('.exr'):
                harness.read_exr(path)
            elif name.endswith(('.h5', '.hdf')):
                with h5py.File(path, 'r') as f:
                    f.visititems(lambda key, item: item[...] if isinstance(item, h5py.Dataset) else None)
            elif name.endswith('.json'):
                with open(path) as f:
                    json.load(f)
            elif name == 'manifest':
                with open(path, 'rb') as f:
                    head, _, last = f.read().rstrip(b'\n').rpartition(b'\n')
                json.loads(head)
                assert last.startswith(b'xxh3_128 ')
        except FileNotFoundError:
            pass  # it was replaced or removed meanwhile
        except Exception as problem:  # noqa: BLE001 - whatever it is, the file is not readable
            bad.append('%s: %s' % (path, problem))
    return bad


def status_bytes(folder):
    try:
        with open(os.path.join(folder, 'checkpoint', 'status.json'), 'rb') as f:
            return f.read()
    except OSError:
        return b''


def generations(folder):
    return sorted(glob.glob(os.path.join(folder, 'checkpoint', 'gen-*')))


def wait_for(what, seconds=30, pause=0.001):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if what():
            return True
        time.sleep(pause)
    return False


def same(checks, tool, reference, folder, process, what):
    if checks.that(process.status == 0, '%s: going on ended with %s instead of 0' % (what, process.status), process):
        different = differences(reference, result(folder))
        checks.that(not different, '%s: not the same: %s' % (what, different), process)
        checks.that(not os.path.exists(os.path.join(folder, 'checkpoint')), '%s: the checkpoint is still there' % what,
                    process)


def reference_of(checks, tool, *more, **how):
    folder = tool.folder()
    process = tool.bake(folder, '--checkpoint-every', 0, *more, threads=2, **how)
    if not checks.that(process.status == 0, 'the reference ended with %d' % process.status, process):
        checks.end()
    return result(folder), process.seconds


# ---- the parts ----

SCENES = [os.path.join(harness.REPOSITORY, 'jobs', name) for name in ('cornell.glb', 'rooms.glb', 'furnace.glb')]
# So little work that a bake is mostly what ranks say and write.
LITTLE = ('--samples-direct', '16', '--samples-bounce', '8', '--samples-indirect', '64', '--samples-probe', '16',
          '--bounces', '2')
# Lightmaps that touch others are in bands where they are not denoised.
IN_BANDS = (*LITTLE, '--denoise', 'none')
WHENEVER, CHECKPOINT, LIGHTMAPS, RESULTS = 'any moment', 'checkpoint writing', 'lightmap writing', 'final writing'
LEAST = {CHECKPOINT: 0.25, LIGHTMAPS: 0.25, RESULTS: 0.125}  # of all kills so far; what falls behind is aimed at next


class Subject:
    """A scene to be killed in: what a bake that nothing happens to leaves, how long some ranks take, and for how long
    of it they write results."""

    def __init__(self, checks, tool, scene, ranks=4, more=()):
        self.scene, folder = scene, tool.folder()
        process = tool.bake(folder, '--checkpoint-every', 0, *more, scene=scene, threads=2)
        if not checks.that(process.status == 0, 'the reference ended with %d' % process.status, process):
            checks.end()
        self.reference = result(folder)
        folder = tool.folder()
        process = tool.bake(folder, *OFTEN, *more, scene=scene, ranks=ranks)
        if not checks.that(process.status == 0, '%d ranks ended with %d' % (ranks, process.status), process):
            checks.end()
        self.seconds = process.seconds
        phases = {phase['name']: phase['seconds']['max'] for phase in run_json(folder)['phases']}
        self.writing = phases.get('denoising', 0) + phases['lightmaps'] + phases['kiln.h5'] + phases['volume.hdf']


def writes_checkpoint(folder, _):
    return bool(glob.glob(os.path.join(folder, 'checkpoint', '.writing-*')))


def writes_lightmap(folder, _):
    return bool(glob.glob(os.path.join(folder, 'lightmaps', '.*.part')))


def writes_results(folder, began):
    """Whether results were written since, and the bake does not claim to be complete."""
    fresh = False
    for path in glob.glob(os.path.join(folder, '*')) + glob.glob(os.path.join(folder, '.*.part')) + glob.glob(
        os.path.join(folder, 'lightmaps', '*')):
        try:
            fresh = fresh or ('scene.kscene' not in path and os.path.isfile(path) and os.stat(path).st_mtime > began)
        except FileNotFoundError:
            pass
    return fresh and not os.path.exists(os.path.join(folder, 'manifest'))


IS_WRITING = {CHECKPOINT: writes_checkpoint, LIGHTMAPS: writes_lightmap, RESULTS: writes_results}


def take_aim(dice, aim, subject, process, folder, began):
    """Waits for the moment; its name."""
    if aim == WHENEVER:
        moment = dice.uniform(0.2, 1.05 * subject.seconds)
        wait_for(lambda: process.poll() is not None, moment)
        return 'after %.2f s' % moment
    wait_for(lambda: process.poll() is not None or IS_WRITING[aim](folder, began))
    delay = dice.uniform(0, subject.writing if aim == RESULTS else 0.004)
    time.sleep(delay)
    return 'in %s, after %.3f s' % (aim, delay)


def belongings(ranks):
    """Files in shared memory that the ranks of a bake have."""
    found = set()
    for rank in ranks:
        try:
            with open('/proc/%d/maps' % rank) as f:
                found.update(line.split(None, 5)[5].rstrip('\n') for line in f if '/dev/shm/' in line)
        except OSError:
            pass
    return found


def holds_memory(path):
    """Open MPI leaves the name, without a page behind it, of a window that was just being opened."""
    try:
        return os.stat(path).st_blocks * 512 > 65536
    except FileNotFoundError:
        return False


def left_over(folder, ranks, segments):
    """What a job that has ended left, as sentences: processes, shared memory, files in its own TMPDIR. What is in the
    output folder is the next run's."""
    def processes():
        found = []
        for path in glob.glob('/proc/[0-9]*/cmdline'):
            try:
                with open(path, 'rb') as f:
                    if os.fsencode(folder) in f.read().split(b'\0'):
                        found.append(path.split('/')[2])
            except OSError:
                pass
        return found
    wait_for(lambda: not processes(), 5)
    bad = ['process %s' % p for p in processes()] + ['shared memory %s' % s for s in segments if holds_memory(s)]
    for kind in ('shm', 'sem', 'msg'):
        with open('/proc/sysvipc/' + kind) as f:
            lines = [dict(zip(head, line.split())) for head in [f.readline().split()] for line in f]
        bad += ['System V %s' % kind for line in lines if line.get('cpid', '') in map(str, ranks)]
    return bad + glob.glob(folder + '.tmp/**/*', recursive=True)


def kill_one(checks, dice, process, ranks, folder, what):
    """SIGKILL to one rank, and what has to hold of the job after it; None when there was none to kill, else the seconds
    to its end and how much shared memory was looked for after it."""
    victim = dice.choice(ranks) if ranks else 0
    try:
        with open('/proc/%d/cmdline' % victim) as f:
            if f.read() == '':
                return None  # it has come to its end
        os.kill(victim, signal.SIGKILL)
    except (FileNotFoundError, ProcessLookupError):
        return None
    began = time.monotonic()
    segments = belongings(ranks)  # the others have them still
    status = finish(process)
    seconds = time.monotonic() - began
    checks.that(status not in (None, 0), '%s: the job ended with %s' % (what, status))
    checks.that(seconds < 20, '%s: the job went on for %.0f s' % (what, seconds))
    checks.that('exited on signal 9' in text(folder, '.out') + text(folder),
                '%s: nobody says which rank died: %s' % (what, text(folder)[-300:]))
    bad = readable(folder) + left_over(folder, ranks, segments)
    checks.that(not bad, '%s: %s' % (what, '; '.join(bad)))
    return seconds, len(segments)


def plant(folder):
    """What Open MPI's locks leave beside a file that was just being opened, if the kill comes then."""
    if os.path.isdir(folder) and not os.path.exists(os.path.join(folder, 'manifest')):
        for name in ('.kiln.h5.part-1798438913-2000.lock', '.volume.hdf.part.locktest.1'):
            open(os.path.join(folder, name), 'w').close()


def shows_bands(checks, tool):
    """Lightmaps of this size are in bands: a rank that does not pack its band fails the bake."""
    process = harness.run(tool.line(tool.folder(), *IN_BANDS, ranks=3), 120,
                          {**harness.MPI_ENVIRONMENT, 'KILN_FAILING_PACKER': '2'})
    checks.that(process.status == SYSTEM and 'KILN_FAILING_PACKER' in process.stderr,
                'lightmaps are not in bands: ended with %d' % process.status, process)


def ends_well(checks, tool, subject, process, folder, what):
    """The last run of a bake that was killed before: the bits of one that was not, and nothing left over."""
    status = harness.own_status(finish(process), text(folder))
    if not checks.that(status == 0, '%s: the last run ended with %s: %s' % (what, status, text(folder)[-3000:])):
        return
    different, bad = differences(subject.reference, result(folder)), readable(folder)
    checks.that(not different, '%s: not the same: %s' % (what, different))
    checks.that(not bad, '%s: %s' % (what, '; '.join(bad)))
    verdict, hidden = tool.run('verify', folder), glob.glob(os.path.join(folder, '**', '.*'), recursive=True)
    checks.that(verdict.status == 0, '%s: not as it was written' % what, verdict)
    checks.that(not hidden and not os.path.exists(os.path.join(folder, 'checkpoint')),
                '%s: left over: %s' % (what, hidden))


class Kills:
    """What was killed so far: how many at which moments and in which phases, the most seconds until a job was gone, and
    how much shared memory was looked for."""

    def __init__(self, most):
        self.most, self.longest, self.seen = most, 0, 0
        self.moments, self.phases = dict.fromkeys((WHENEVER, *LEAST), 0), collections.Counter()

    def done(self):
        return sum(self.moments.values())

    def aim(self):
        return next((aim for aim in LEAST if self.moments[aim] < LEAST[aim] * (self.done() + 1)), WHENEVER)

    def add(self, folder, began, seconds, segments):
        moment = next((aim for aim in LEAST if IS_WRITING[aim](folder, began)), WHENEVER)
        status = status_bytes(folder)
        self.moments[moment] += 1
        self.phases[json.loads(status)['phase'] if status else 'before any, or after all'] += 1
        self.longest, self.seen = max(self.longest, seconds), self.seen + segments


def kill_and_go_on(checks, tool, dice, subject, kills, ranks=3):
    """A bake that is killed some times, and gone on with each time, to its end."""
    folder, interruptions, most = tool.folder(), 0, dice.randrange(3, 9)
    while True:
        plant(folder)
        began = time.time()
        process = tool.start(folder, *OFTEN, *IN_BANDS, scene=subject.scene, ranks=ranks, private=True)
        killed = None
        if kills.done() < kills.most and interruptions < most:
            wait_for(lambda: process.poll() is not None or len(ranks_of(process)) == ranks, pause=LOOK)
            alive = ranks_of(process)
            moment = take_aim(dice, kills.aim(), subject, process, folder, began)
            killed = kill_one(checks, dice, process, alive, folder, 'kill %d, %s' % (kills.done() + 1, moment))
        if killed is None:
            ends_well(checks, tool, subject, process, folder,
                      '%s after %d interruptions' % (os.path.basename(subject.scene), interruptions))
            break
        kills.add(folder, began, *killed)
        interruptions += 1
        if kills.most > 20:
            print('kill %d, %s' % (kills.done(), moment), flush=True)
    shutil.rmtree(folder, ignore_errors=True)


def try_kills(checks, tool):
    kills = Kills(int(os.environ.get('KILN_KILLS', '200' if tool.full else '3')))
    seed = int(os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice = random.Random(seed)
    print('seed %d (KILN_SEED=%d repeats it), %d kills' % (seed, seed, kills.most), flush=True)
    os.environ['KILN_DIVIDE_FROM'] = '1'
    shows_bands(checks, tool)
    subjects, bakes = {}, 0
    while kills.done() < kills.most:
        scene = SCENES[bakes % len(SCENES) if kills.most > 20 else 0]
        subject = subjects.get(scene) or subjects.setdefault(scene, Subject(checks, tool, scene, 3, IN_BANDS))
        kill_and_go_on(checks, tool, dice, subject, kills)
        bakes += 1
    checks.that(kills.seen > 0, 'no shared memory was ever seen, so none can be said to be gone')
    print('%d kills in %d bakes of %d scenes; the job was gone after %.1f s at most' %
          (kills.done(), bakes, len(subjects), kills.longest))
    print('moments: ' + ', '.join('%s %d' % moment for moment in kills.moments.items()))
    print('phases: ' + ', '.join('%s %d' % phase for phase in kills.phases.most_common()))


def kill_at_the_end(checks, tool, dice, subject):
    """SIGKILL to a rank once the manifest is there, or just before; whether there was one to kill."""
    folder = tool.folder()
    process = tool.start(folder, *OFTEN, ranks=4, private=True)
    wait_for(lambda: process.poll() is not None or len(ranks_of(process)) == 4, pause=LOOK)
    ranks, written = ranks_of(process), dice.choice(('manifest', 'volume.hdf'))
    wait_for(lambda: process.poll() is not None or os.path.exists(os.path.join(folder, written)))
    delay = dice.uniform(0, 0.3)
    time.sleep(delay)
    segments, victim, began = belongings(ranks), dice.choice(ranks), time.monotonic()
    try:
        os.kill(victim, signal.SIGKILL)
    except ProcessLookupError:
        finish(process)
        return False
    status, what = finish(process), 'rank %d killed %.3f s after %s' % (ranks.index(victim), delay, written)
    checks.that(status is not None and time.monotonic() - began < 20,
                '%s: the job went on for %.0f s' % (what, time.monotonic() - began))
    if os.path.exists(os.path.join(folder, 'manifest')):
        verdict, different = tool.run('verify', folder), differences(subject.reference, result(folder))
        checks.that(verdict.status == 0, '%s: not as it was written' % what, verdict)
        checks.that(not different, '%s: not the same: %s' % (what, different))
    bad = readable(folder) + left_over(folder, ranks, segments)
    checks.that(not bad, '%s: %s' % (what, '; '.join(bad)))
    process = tool.bake(folder, ranks=2)
    same(checks, tool, subject.reference, folder, process, what)
    shutil.rmtree(folder, ignore_errors=True)
    return True


def kill_mpirun(checks, tool, subject, stopped):
    """SIGKILL to mpirun, once with a rank that stands still: the ranks end by themselves, and what they shared is free.
    Open MPI's own files stay, which only mpirun removes: a queue of some pages a rank, and its folder in TMPDIR."""
    folder = tool.folder()
    process = tool.start(folder, *OFTEN, ranks=3, private=True)
    wait_for(lambda: process.poll() is not None or generations(folder))
    ranks = ranks_of(process)
    segments = belongings(ranks)
    if stopped:
        os.kill(ranks[1], signal.SIGSTOP)
        # the kernel wakes and ends what stands still when its parent goes, not what is about to: all of its threads
        wait_for(lambda: all(state_of('%d/task/%s' % (ranks[1], t)) == 'T' for t in threads_of(ranks[1])))
    began = time.monotonic()
    process.kill()
    process.wait()
    gone = wait_for(lambda: all(state_of(rank) == 'Z' for rank in ranks), 30)
    seconds = time.monotonic() - began
    checks.that(gone and seconds < 10, 'mpirun killed: ranks are there after %.1f s' % seconds)
    queues = [s for s in segments if 'vader_segment' in s]
    shutil.rmtree(folder + '.tmp', ignore_errors=True)
    bad = readable(folder) + left_over(folder, ranks, segments - set(queues))
    checks.that(not bad, 'mpirun killed: %s' % '; '.join(bad))
    for path in queues:
        if os.path.exists(path):
            os.remove(path)
    same(checks, tool, subject.reference, folder, tool.bake(folder, ranks=2), 'after mpirun was killed')
    return seconds


def try_ends(checks, tool):
    ends, seed = int(os.environ.get('KILN_ENDS', '1')), int(os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice, done, tries = random.Random(seed), 0, 0
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed), flush=True)
    subject = Subject(checks, tool, SCENE)
    while done < ends and tries < 5 * ends:
        done, tries = done + kill_at_the_end(checks, tool, dice, subject), tries + 1
    longest = max(kill_mpirun(checks, tool, subject, stopped) for stopped in (False, True))
    print('%d ranks killed at the end; mpirun killed twice, and the ranks gone after %.1f s at most' % (done, longest))


def interrupted(tool, checks, ranks=0, threads=1, after=2, more=(), **how):
    """A folder with a bake stopped in the middle, once it has written so many generations."""
    folder = tool.folder()
    process = tool.start(folder, *OFTEN, *more, ranks=ranks, threads=threads, **how)
    number = lambda: max([int(g[-6:]) for g in generations(folder)], default=0)
    wait_for(lambda: number() >= after or process.poll() is not None)
    for rank in ranks_of(process):
        os.kill(rank, signal.SIGUSR1)
        break
    status = finish(process)
    checks.that(status == STOPPED, 'stopped by SIGUSR1 on one rank it ended with %s, not 75: %s' %
                (status, text(folder)[-400:]))
    return folder


def try_layouts(checks, tool):
    reference, _ = reference_of(checks, tool)
    changes = ((3, 1, 2), (2, 5, 1), (1, 2, 1))
    for i, (before, after, threads) in enumerate(changes if tool.full else changes[:2]):
        folder = interrupted(tool, checks, ranks=before, after=2 + i)
        same(checks, tool, reference, folder, tool.bake(folder, ranks=after, threads=threads),
             '%d ranks, then %d' % (before, after))
        shutil.rmtree(folder, ignore_errors=True)
    scene = glb.partition_room(os.path.join(tool.scratch, 'two_sides.glb'), False)
    reference, _ = reference_of(checks, tool, '--sides', 'two', scene=scene)
    folder = interrupted(tool, checks, ranks=1, more=('--sides', 'two'), scene=scene)
    same(checks, tool, reference, folder, tool.bake(folder, '--sides', 'two', ranks=3, scene=scene),
         'double-sided, 1 rank, then 3')


def killed_within(checks, tool, folder, phase, ranks, more=QUANTITIES, **how):
    """Goes on, and kills a rank that halts when it has saved something of the step."""
    process = tool.start(folder, *OFTEN, *more, ranks=ranks, halt='%d:saved %s' % (ranks - 1, phase), **how)
    halted = lambda: [rank for rank in ranks_of(process) if state_of(rank) == 'T']
    wait_for(lambda: process.poll() is not None or halted(), pause=LOOK)
    killed = halted()
    for rank in killed:
        os.kill(rank, signal.SIGKILL)
    status = finish(process)
    checks.that(killed and status not in (None, 0),
                'within %s: %d killed, it ended with %s: %s' % (phase, len(killed), status, text(folder)[-300:]))


def try_quantities(checks, tool):
    reference, _ = reference_of(checks, tool, *QUANTITIES)
    checks.that('kiln.h5 occlusion/bent_normal' in reference and 'kiln.h5 directional/sh' in reference,
                'the reference has no quantities: %s' % sorted(reference))
    folder = tool.folder()
    killed_within(checks, tool, folder, 'ambient occlusion', 2)
    killed_within(checks, tool, folder, 'light by direction', 3)
    same(checks, tool, reference, folder, tool.bake(folder, *QUANTITIES), 'killed within each quantity')
    for changed in ((), (*QUANTITIES, '--ambient-occlusion', 0.6), (*QUANTITIES, '--directional', 'dominant')):
        stopped = interrupted(tool, checks, more=QUANTITIES) if changed == () else stopped
        process = tool.bake(stopped, *changed)
        checks.that(process.status == BAD_INPUT and 'in the checkpoint' in process.stderr,
                    'other quantities (%s) were not refused: %d' % (changed, process.status), process)


# Little light: of these bakes the checkpoints matter. In the final gather there is time for many.
SMALL = ('--lightmap-size', 16, '--samples-direct', 16, '--samples-bounce', 8, '--samples-indirect', 1024, '--bounces',
         1, '--samples-probe', 4)


def number_of(path):
    return int(path.rsplit('-', 1)[1])


def on_nodes(local):
    """Numbers of the generations that each rank has on its node: {rank's folder: [number]}."""
    return {rank: sorted(map(number_of, glob.glob(os.path.join(rank, 'checkpoint', 'gen-*'))))
            for rank in glob.glob(os.path.join(local, 'kiln-*', 'rank-*'))}


def killed_locally(checks, tool, local):
    """A bake on three ranks that is killed once it has saved something of its final gather."""
    folder = tool.folder()
    killed_within(checks, tool, folder, 'final gather', 3,
                  more=(*SMALL, '--checkpoint-every', 0.001, '--checkpoint-local', local))
    there = on_nodes(local)
    if not checks.that(len(there) == 3 and all(there.values()), 'no checkpoints on the nodes: %s' % there):
        checks.end()
    return folder, min(numbers[-1] for numbers in there.values())


def try_local(checks, tool):
    reference, _ = reference_of(checks, tool, *SMALL)
    local = os.path.join(tool.scratch, 'local')
    os.makedirs(local)
    # nothing was copied: the newest that all ranks have comes from the nodes
    folder, newest = killed_locally(checks, tool, local)
    other, others = tool.folder(), local + '.other'
    shutil.copytree(folder, other)
    shutil.copytree(local, others)
    for left in glob.glob(os.path.join(folder, 'checkpoint', '*gen-*')) + glob.glob(
            os.path.join(folder, 'checkpoint', '.writing-*')):
        shutil.rmtree(left)
    process = tool.bake(folder, *SMALL, '--checkpoint-local', local, ranks=2)
    checks.that('checkpoint %d is copied from the nodes' % newest in process.stderr, 'nothing came from the nodes',
                process)
    same(checks, tool, reference, folder, process, 'from the nodes')
    checks.that(not os.listdir(local), 'left on the nodes: %s' % on_nodes(local))
    # a node is lost: the newest copied one
    copied = max(map(number_of, generations(other)), default=0)
    checks.that(newest - 1 <= copied, 'checkpoint %d is on the nodes, and %d was the last copied' % (newest, copied))
    shutil.rmtree(sorted(on_nodes(others))[1])
    process = tool.bake(other, *SMALL, '--checkpoint-local', others)
    checks.that('going on from checkpoint %d' % copied in process.stderr, 'not from checkpoint %d' % copied, process)
    same(checks, tool, reference, other, process, 'without a node')
    checks.that(not os.listdir(others), 'left on the nodes: %s' % on_nodes(others))
    for wrong, words in ((local + '.none', 'there is no folder'), (tool.kiln, 'is no folder')):
        process = tool.bake(tool.folder(), *SMALL, '--checkpoint-local', wrong)
        checks.that(process.status == CANNOT_CREATE and words in process.stderr,
                    '--checkpoint-local %s: %d' % (wrong, process.status), process)


def try_blocks(checks, tool):
    """Blocks are found again, by other ranks too; another scale is another bake."""
    more = ('--indirect-scale', 4, '--samples-bounce', 8192, '--bounces', 3, '--no-error-map')
    reference, _ = reference_of(checks, tool, *more)
    folder = tool.folder()
    killed_within(checks, tool, folder, 'bounce 1', 3, more)
    process = tool.bake(folder, '--samples-bounce', 8192, '--bounces', 3, '--no-error-map')
    checks.that(process.status == BAD_INPUT and 'indirect-scale' in process.stderr,
                'another scale was not refused: %d' % process.status, process)
    same(checks, tool, reference, folder, tool.bake(folder, *more), 'killed within a bounce by blocks')
    views = ('--indirect-scale', 4, '--final-scale', 2, '--only-visible-from', 'all', '--no-error-map',
             '--samples-indirect', 4096)
    reference, _ = reference_of(checks, tool, *views)
    folder = tool.folder()
    killed_within(checks, tool, folder, 'final gather', 3, views)
    process = tool.bake(folder, *views, '--final-scale', 4)
    checks.that(process.status == BAD_INPUT and 'final-scale' in process.stderr,
                'another scale of the final gather was not refused: %d' % process.status, process)
    same(checks, tool, reference, folder, tool.bake(folder, *views), 'killed within a final gather by nodes for a view')


def try_range(checks, tool):
    """Radiance probes are placed and gathered again after a kill, for a step that has begun too."""
    more = ('--tracing-range', 1, '--radiance-probe-spacing', 0.6, '--samples-radiance-probe', 8192, '--bounces', 2,
            '--samples-indirect', 1024, '--no-error-map')
    reference, _ = reference_of(checks, tool, *more)
    for ranks, after, phase in ((3, 1, 'final gather'), (1, 4, 'radiance probes')):
        folder = tool.folder()
        killed_within(checks, tool, folder, phase, ranks, more)
        same(checks, tool, reference, folder, tool.bake(folder, *more, ranks=after), 'killed within %s' % phase)


def try_guide(checks, tool):
    """What rays have learnt is kept: killed while they learn, while they learn and follow, and while they follow, on
    other numbers of ranks."""
    more = ('--guide', 'auto', '--samples-bounce', 1024, '--samples-indirect', 2048, '--bounces', 3, '--no-error-map')
    reference, _ = reference_of(checks, tool, *more)
    folder = tool.folder()
    killed_within(checks, tool, folder, 'bounce 1', 2, more)
    killed_within(checks, tool, folder, 'bounce 2', 3, more)
    process = tool.bake(folder, *(word for word in more if word not in ('--guide', 'auto')))
    checks.that(process.status == BAD_INPUT and 'guide' in process.stderr,
                'a bake without a guide was not refused: %d' % process.status, process)
    killed_within(checks, tool, folder, 'final gather', 1, more)
    same(checks, tool, reference, folder, tool.bake(folder, *more), 'killed within guided gathers')


def try_caustics(checks, tool):
    """Light by way of a mirror and of glass: killed within caustics and within the final gather, on other numbers of
    ranks; diffuse, it is another bake."""
    scene = os.path.join(tool.scratch, 'spheres.glb')
    tool.run('generate', 'cornell-spheres', '-o', scene)
    more = ('--materials', 'auto', '--caustics', 'gather', '--lightmap-size', 24, '--samples-indirect', 1024,
            '--bounces', 2)
    reference, _ = reference_of(checks, tool, *more, scene=scene)
    checks.that('kiln.h5 irradiance/caustic' in reference, 'the reference has no caustics: %s' % sorted(reference))
    folder = tool.folder()
    killed_within(checks, tool, folder, 'caustics', 3, more, scene=scene)
    process = tool.bake(folder, *more, '--materials', 'diffuse', scene=scene)
    checks.that(process.status == BAD_INPUT and 'materials' in process.stderr and 'caustics' in process.stderr,
                'a diffuse bake was not refused: %d' % process.status, process)
    killed_within(checks, tool, folder, 'final gather', 2, more, scene=scene)
    same(checks, tool, reference, folder, tool.bake(folder, *more, scene=scene), 'killed within caustics')


def landed(folder):
    """What the newest checkpoint says of light paths: iterations that are done; 0: nothing, or it goes just now."""
    try:
        generation = generations(folder)[-1]
        with open(os.path.join(generation, 'manifest')) as f:
            parts = json.loads(f.readline())['parts']
        place = next(block[4] for block in parts[0]['blocks'] if block[0] == 'landing')
        with open(os.path.join(generation, 'part-00000'), 'rb') as f:
            f.seek(place)
            return struct.unpack('2Q', f.read(16))[1]
    except (IndexError, OSError, StopIteration):
        return 0


def try_landing(checks, tool):
    """Light paths go on where the checkpoint has them, and land alike, merged or not; other numbers of them are
    another bake."""
    iterations = 20
    for which in ('land', 'merge') if tool.full else ('merge',):  # landing alone is in `paths`
        least = ('--materials', 'full', '--bounces', 1, '--samples-indirect', 16, '--no-error-map')
        more = (*least, '--caustics', which, '--photons', 100000, '--iterations', iterations)
        straight, folder = tool.folder(), tool.folder()
        process = tool.bake(straight, '--checkpoint-every', 0, *more)
        if not checks.that(process.status == 0, 'the reference ended with %d' % process.status, process):
            return
        for ranks in (2, 1):  # killed once half of all have landed, and again when a checkpoint has been written
            before = generations(folder)
            process = tool.start(folder, *OFTEN, *more, ranks=ranks)
            wait_for(lambda: process.poll() is not None or
                     (generations(folder)[-1:] != before[-1:] and (ranks == 1 or landed(folder) >= iterations // 2)))
            for rank in ranks_of(process)[-1:]:
                os.kill(rank, signal.SIGKILL)
            finish(process)
            checks.that(landed(folder) >= iterations // 2, '%s: killed after %d iterations' % (which, landed(folder)))
        for other in ((*more, '--photons', 100001), (*more, '--iterations', 21), (*least, '--caustics', 'gather')):
            process = tool.bake(folder, *other)
            checks.that(process.status == BAD_INPUT and other[-2][2:] in process.stderr,
                        '%s %s was not refused: %d' % (*other[-2:], process.status), process)
        process = tool.bake(folder, *more, ranks=3)
        same(checks, tool, result(straight), folder, process, '%s: killed while light paths landed' % which)
        rays = []
        for bake in (straight, folder):
            rays.append(run_json(bake)['rays'])
        checks.that(rays[0] == rays[1], '%s: %s rays, and %s at a stretch' % (which, rays[1], rays[0]))


def try_sharing(checks, tool):
    """The same of paths that share the light with gather rays, aimed as pilots have taught; the rays are killed too."""
    more = ('--materials', 'full', '--caustics', 'vcm', '--photons', 250000, '--iterations', 3, '--bounces', 1,
            '--samples-indirect', 512, '--no-error-map')
    reference, _ = reference_of(checks, tool, *more)
    folder = tool.folder()
    killed_within(checks, tool, folder, 'light paths', 1, more)
    killed_within(checks, tool, folder, 'caustics by rays', 2, more)
    for other in (('--mis', 'power'), ('--caustics', 'land')):
        process = tool.bake(folder, *more, *other)
        checks.that(process.status == BAD_INPUT and other[0][2:] in process.stderr,
                    '%s %s was not refused: %d' % (*other, process.status), process)
    same(checks, tool, reference, folder, tool.bake(folder, *more, ranks=3), 'killed while light was shared')


def try_growing(checks, tool):
    """Light paths that grow from round to round with the rays: killed in a round that has more than the first."""
    more = ('--materials', 'full', '--caustics', 'vcm', '--photons', 3000, '--iterations', 'all', '--target-error', 0.2,
            '--bounces', 0, '--samples-indirect', 16, '--samples-probe', 4, '--lightmap-size', 16)
    reference, _ = reference_of(checks, tool, *more)
    folder = tool.folder()
    process = tool.start(folder, *OFTEN, *more, ranks=2)
    wait_for(lambda: process.poll() is not None or landed(folder) > 16)
    for rank in ranks_of(process)[-1:]:
        os.kill(rank, signal.SIGKILL)
    finish(process)
    checks.that(landed(folder) > 16, 'killed after %d iterations' % landed(folder))
    process = tool.bake(folder, *more, '--iterations', 16)
    checks.that(process.status == BAD_INPUT and 'iterations' in process.stderr,
                'another number of iterations was not refused: %d' % process.status, process)
    same(checks, tool, reference, folder, tool.bake(folder, *more, ranks=3), 'killed in a later round')


def try_crossing(checks, tool):
    """Probes get what light paths bring once, killed while they do, and stopped when all is computed."""
    scene = os.path.join(tool.scratch, 'spheres.glb')
    tool.run('generate', 'cornell-spheres', '-o', scene)
    more = ('--materials', 'auto', '--caustics', 'land', '--lightmap-size', 8, '--bounces', 0, '--samples-probe', 64,
            '--photons', 60000, '--iterations', 8, '--no-error-map')
    reference, _ = reference_of(checks, tool, *more, scene=scene)
    checks.that(any('irradiance_sh' in name for name in reference),
                'the reference has no probes: %s' % sorted(reference))
    folder = tool.folder()
    killed_within(checks, tool, folder, 'light paths at probes', 3, more, scene=scene)
    killed_within(checks, tool, folder, 'light paths at probes', 1, more, scene=scene)
    same(checks, tool, reference, folder, tool.bake(folder, *more, ranks=2, scene=scene), 'killed while paths crossed')


def kill_by_turns(checks, tool, dice, more, kills, scene):
    """Bakes that are killed and gone on with by another number of ranks each time, until all kills are spent. Each
    gives the bits of one that nothing happens to. The first kill comes when a checkpoint has landed light, if there is
    one in time, others at any moment. Returns the phases that were killed within, as far as status.json had them."""
    reference, seconds = reference_of(checks, tool, *more, scene=scene)
    turns, within, folder, aimed = itertools.cycle((8, 1, 5, 2, 3)), [], tool.folder(), True
    while True:
        ranks = next(turns)
        process = tool.start(folder, '--checkpoint-every', 0.2, *more, scene=scene, ranks=ranks, private=True)
        if len(within) < kills:
            wait_for(lambda: process.poll() is not None or len(ranks_of(process)) == ranks, pause=LOOK)
            moment = 30 if aimed else dice.uniform(0.2, seconds)
            wait_for(lambda: process.poll() is not None or (aimed and landed(folder) > 0), moment, pause=LOOK)
            what, aimed = 'kill %d, of %d ranks, after %.2f s at most' % (len(within) + 1, ranks, moment), False
            if kill_one(checks, dice, process, ranks_of(process), folder, what) is not None:
                status = status_bytes(folder)
                within.append(json.loads(status)['phase'] if status else 'before any')
                continue
        status = harness.own_status(finish(process, 120), text(folder))
        if checks.that(status == 0, 'the last run ended with %s: %s' % (status, text(folder)[-3000:])):
            different = differences(reference, result(folder))
            checks.that(not different, 'after %d kills: not the same: %s' % (len(within), different))
        if len(within) == kills:
            return within
        shutil.rmtree(folder, ignore_errors=True)


def try_paths(checks, tool):
    """Light paths that land in texels, and such that share light with gather rays."""
    kills, seed = int(os.environ.get('KILN_KILLS', '1')), int(os.environ.get('KILN_SEED', '0'))
    scene = os.path.join(tool.scratch, 'spheres.glb')
    tool.run('generate', 'cornell-spheres', '-o', scene)
    for which in ('land', 'vcm'):
        more = ('--materials', 'auto', '--caustics', which, '--photons', 8000, '--iterations', 12, '--lightmap-size',
                16, '--samples-direct', 16, '--samples-bounce', 8, '--samples-indirect', 64, '--bounces', 2,
                '--samples-probe', 8, '--no-export')
        within = kill_by_turns(checks, tool, random.Random(seed), more, kills, scene)
        print('%s, seed %d: killed within %s' % (which, seed, ', '.join(within)), flush=True)


def try_bounces(checks, tool):
    """More passes than an array of a fixed size would hold, at a stretch and in two."""
    few = ('--lightmap-size', 8, '--samples-direct', 4, '--samples-bounce', 2, '--samples-indirect', 4,
           '--samples-probe', 4, '--no-export', '--no-error-map', '--checkpoint-every', 0)
    scene = SCENES[2]
    for more, passes in ((('--bounces', 300, '--schedule', 'equal'), 301), (('--bounces', 1000), 1001)):
        folder = tool.folder()
        process = tool.bake(folder, *few, *more, scene=scene)
        if checks.that(process.status == 0, '%s: ended with %d' % (' '.join(map(str, more)), process.status), process):
            run = run_json(folder)
            checks.that(len(run['bounces']) == passes and run['indirect_bounces'] == passes - 1,
                        '%s: %d passes and %d bounces' % (more, len(run['bounces']), run['indirect_bounces']))
    many = (*few, '--lightmap-size', 32, '--bounces', 1500)
    reference, _ = reference_of(checks, tool, *many, scene=scene)
    folder = tool.folder()
    process = tool.start(folder, *many, ranks=2, scene=scene)

    def bounce():
        phase = tool.run('status', folder, '--json') if os.path.exists(os.path.join(folder, 'checkpoint')) else None
        words = phase.json().get('phase', '').split() if phase is not None and phase.status == 0 else []
        return int(words[1]) if words[:1] == ['bounce'] else 0
    wait_for(lambda: bounce() > 256 or process.poll() is not None)
    tool.run('stop', folder)
    status = finish(process)
    checks.that(status == STOPPED, 'stopped after 256 bounces it ended with %s, not 75: %s' %
                (status, text(folder)[-400:]))
    same(checks, tool, reference, folder, tool.bake(folder, *many, scene=scene), 'stopped after 256 bounces')


def try_signals(checks, tool):
    reference, seconds = reference_of(checks, tool)
    for number in (signal.SIGUSR1, signal.SIGTERM, signal.SIGINT):
        folder = tool.folder()
        process = tool.start(folder, *OFTEN)
        wait_for(lambda: generations(folder) or process.poll() is not None)
        began = time.monotonic()
        process.send_signal(number)
        if number == signal.SIGUSR1:
            process.send_signal(number)  # may come twice
        status = finish(process)
        checks.that(status == STOPPED, '%s: ended with %s, not 75' % (number.name, status))
        checks.that(time.monotonic() - began < 20, '%s: took %.0f s' % (number.name, time.monotonic() - began))
        checks.that(number.name in text(folder) and 'same command' in text(folder),
                    '%s: not named: %s' % (number.name, text(folder)[-300:]))
        state = tool.run('status', folder, '--json')
        checks.that(state.status == 0 and state.json()['state'] == state.json()['status'] == 'stopped',
                    '%s: status says %s' % (number.name, state.stdout), state)
        if number != signal.SIGUSR1 and not tool.full:
            continue
        again = tool.bake(folder)
        checks.that('going on from checkpoint' in again.stderr, '%s: does not say that it goes on' % number.name, again)
        same(checks, tool, reference, folder, again, number.name)

    folder = tool.folder()  # two ranks, through mpirun
    process = tool.start(folder, *OFTEN, ranks=2)
    wait_for(lambda: generations(folder) or process.poll() is not None)
    process.send_signal(signal.SIGUSR1)
    status = finish(process)
    checks.that(status == STOPPED, 'SIGUSR1 to mpirun: ended with %s, not 75: %s' % (status, text(folder)[-300:]))
    same(checks, tool, reference, folder, tool.bake(folder, ranks=3), 'SIGUSR1 to mpirun')

    folder = tool.folder()  # kiln stop, kiln status
    process = tool.start(folder, *OFTEN, ranks=2)
    wait_for(lambda: generations(folder) or process.poll() is not None)
    state = tool.run('status', folder, '--json')
    checks.that(state.status == 0 and state.json()['state'] == 'running' and state.json()['ranks'] == 2,
                'status of a running bake: %s' % state.stdout, state)
    stop = tool.run('stop', folder)
    checks.that(stop.status == 0, 'kiln stop ended with %d' % stop.status, stop)
    status = finish(process)
    checks.that(status == STOPPED and 'kiln stop' in text(folder), 'kiln stop: ended with %s, not 75: %s' %
                (status, text(folder)[-300:]))
    stop = tool.run('stop', folder)
    checks.that(stop.status == 66, 'kiln stop without a bake ended with %d' % stop.status, stop)
    same(checks, tool, reference, folder, tool.bake(folder, ranks=2), 'kiln stop')
    state = tool.run('status', folder, '--json')
    checks.that(state.status == 0 and state.json()['state'] == 'done', 'status of a finished bake: %s' % state.stdout,
                state)

    limit = 0.35 * seconds
    # as many short runs as it takes; the reference may have been made when the machine was more or less busy than now
    while True:
        folder, runs = tool.folder(), 0
        while runs < 50:
            process = tool.bake(folder, '--max-time', limit * 1.05 ** runs, *OFTEN)
            runs += 1
            if process.status != STOPPED:
                break
            checks.that('--max-time' in process.stderr, '--max-time: not named', process)
        if runs >= 3 or limit < 0.05 * seconds:
            break
        limit /= 2
    checks.that(runs >= 3, '--max-time: only %d runs' % runs, process)
    same(checks, tool, reference, folder, process, '--max-time, %d runs' % runs)

    folder = tool.folder()  # within the probes
    process = tool.start(folder, *OFTEN, *PROBES, ranks=2)
    wait_for(lambda: b'probes' in status_bytes(folder) or process.poll() is not None)
    other = tool.bake(folder)
    checks.that(other.status == CANNOT_CREATE and 'another bake' in other.stderr,
                'a second bake in the folder ended with %d' % other.status, other)
    tool.run('stop', folder)
    status = finish(process)
    checks.that(status == STOPPED, 'stopped within the probes it ended with %s: %s' % (status, text(folder)[-300:]))
    other = folder + '-other'  # with fewer rays a probe: all that is kept but the probes is of use
    shutil.copytree(folder, other)
    again = tool.bake(other, ranks=2)
    checks.that('they are gathered again' in again.stderr, 'other probes: not said', again)
    same(checks, tool, reference, other, again, 'other probes')
    again = tool.bake(folder, *PROBES, ranks=3)
    whole = tool.folder()
    checks.that(tool.bake(whole, *PROBES, threads=2).status == 0, 'a bake with more probe rays')
    same(checks, tool, result(whole), folder, again, 'within the probes')

    folder = tool.folder()  # the second SIGINT leaves at once
    process = tool.start(folder, *OFTEN)
    wait_for(lambda: generations(folder) or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    process.send_signal(signal.SIGINT)
    began = time.monotonic()
    status = finish(process)
    checks.that(status in (-signal.SIGINT, STOPPED) and time.monotonic() - began < 10,
                'two SIGINT: ended with %s after %.1f s' % (
        status, time.monotonic() - began))
    checks.that(not readable(folder), 'two SIGINT: %s' % readable(folder))
    same(checks, tool, reference, folder, tool.bake(folder), 'two SIGINT')


PHASES = ('import', 'scene and BVH', 'surface points', 'validity', 'emission', 'direct light', 'final gather',
          'ambient occlusion', 'light by direction', 'probes', 'lightmaps', 'kiln.h5', 'volume.hdf',
          'scene.glb', 'preview')
SOME_PHASES = ('import', 'surface points', 'direct light', 'final gather', 'light by direction', 'probes', 'lightmaps',
               'volume.hdf')  # without --full


def try_phases(checks, tool):
    """One of two ranks is told to stop when it has come to a phase (where it halts until it is told): all end, say
    what is kept, and go on from there. How long that took is printed."""
    # each phase is as short as can be, for the rank halts in it anyway
    options = ('--preview', *QUANTITIES, '--samples-indirect', 64, '--lightmap-size', 24)
    reference, _ = reference_of(checks, tool, *options)
    phases = PHASES if tool.full else SOME_PHASES
    folder, slowest, kept = tool.folder(), 0, False
    for phase in phases:
        process = tool.start(folder, *options, '--watchdog', 100, ranks=2, halt='1:' + phase)
        wait_for(lambda: process.poll() is not None
                 or (len(ranks_of(process)) == 2 and 'T' in map(state_of, ranks_of(process))), pause=LOOK)
        halted = [rank for rank in ranks_of(process) if state_of(rank) == 'T']
        if not checks.that(len(halted) == 1, '%s: no rank came to it: %s' % (phase, text(folder)[-300:])):
            finish(process)
            continue
        os.kill(halted[0], signal.SIGHUP)
        began = time.monotonic()
        while process.poll() is None and time.monotonic() - began < 30:  # some phases are begun twice
            if state_of(halted[0]) == 'T':
                os.kill(halted[0], signal.SIGCONT)
            time.sleep(0.01)
        status = finish(process)
        slowest, said = max(slowest, time.monotonic() - began), text(folder)
        checks.that(status == STOPPED and 'stopped by SIGHUP' in said,
                    '%s: ended with %s: %s' % (phase, status, said[-300:]))
        kept = kept or PHASES.index(phase) >= PHASES.index('direct light')
        words = 'nothing to keep' if not kept else 'goes on from it'
        checks.that(words in said and bool(generations(folder)) == kept, '%s: what is kept: %s' % (phase, said[-300:]))
        checks.that(not readable(folder), '%s: %s' % (phase, readable(folder)))
    same(checks, tool, reference, folder, tool.bake(folder, *options),
         'stopped in each of %d phases' % len(phases))
    print('stopped in each of %d phases, after %.1f s at most' % (len(phases), slowest))


def try_warnings(checks, tool):
    """SIGUSR1 to mpirun at any moment, as a batch script passes it on: all ranks save and end with 75 in a few seconds,
    or the bake is done."""
    warnings, seed = int(os.environ.get('KILN_WARNINGS', '50')), int(
        os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice, ends, slowest, given = random.Random(seed), {}, 0, 0
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed), flush=True)
    subject = Subject(checks, tool, SCENE)
    while given < warnings:
        folder, status = tool.folder(), STOPPED
        while status != 0:
            process = tool.start(folder, *OFTEN, ranks=4)
            # its handlers are there
            wait_for(lambda: process.poll() is not None or b'"running"' in status_bytes(folder))
            moment = dice.uniform(0, subject.seconds)
            wait_for(lambda: process.poll() is not None, moment)
            began, warned = time.monotonic(), process.poll() is None and given < warnings
            if warned:
                process.send_signal(signal.SIGUSR1)
                given += 1
            status = finish(process)
            if warned:
                slowest = max(slowest, time.monotonic() - began)
                ends[status] = ends.get(status, 0) + 1
                bad = readable(folder)
                checks.that(not bad, 'after %.2f s: %s' % (moment, '; '.join(bad)))
            if not checks.that(status in (0, STOPPED), 'warned after %.2f s it ended with %s: %s' %
                               (moment, status, text(folder)[-300:])):
                break
        if status == 0:
            different = differences(subject.reference, result(folder))
            checks.that(not different, 'not the same: %s' % different)
        shutil.rmtree(folder, ignore_errors=True)
    print('%d warnings, all obeyed within %.1f s; ended with: %s' %
          (given, slowest, ', '.join('%s: %d times' % end for end in ends.items())))


def try_refusals(checks, tool):
    reference, _ = reference_of(checks, tool)
    folder = interrupted(tool, checks)
    # The table has a row for what differs and no other, so several are refused at once.
    for changes in ((('seed', 1),),
                    (('samples-direct', 31), ('samples-bounce', 31), ('samples-indirect', 255), ('bounces', 3),
                     ('schedule', 'equal'), ('lightmap-size', 63), ('cell-size', 0.7), ('partition', 'objects')),
                    (('environment', '1,1,1'), ('environment-scale', 2), ('environment-rotation', 3),
                     ('texels-per-metre', 20), ('lightmap-max', 2048), ('target-error', 0.1))):
        process = tool.bake(folder, *(word for name, value in changes for word in ('--' + name, value)))
        rows = {line.split()[0] for line in process.stderr.splitlines() if line.strip()}
        missed = [name for name, _ in changes if name not in rows]
        checks.that(process.status == BAD_INPUT and 'in the checkpoint' in process.stderr and not missed,
                    '%s: refused with a table without %s: %d' % (changes, missed, process.status), process)
    for flag in ('--tail', '--repack', '--no-error-map'):
        process = tool.bake(folder, flag)
        checks.that(process.status == BAD_INPUT, '%s was not refused: %d' % (flag, process.status), process)
    changed = os.path.join(tool.scratch, 'cornell.glb')
    with open(SCENE, 'rb') as f:
        data = f.read()
    with open(changed, 'wb') as f:
        f.write(re.sub(rb'("baseColorFactor":\[0\.)\d', rb'\g<1>3', data, count=1))
    process = tool.bake(folder, scene=changed)
    checks.that(process.status == BAD_INPUT and 'scene content' in process.stderr and 'cornell.glb' in process.stderr,
                'a changed colour was not refused: %d' % process.status, process)
    path = os.path.join(tool.scratch, 'path.csv')
    views = ('--only-visible-from', path, '--no-error-map', '--samples-indirect', 2048)
    for to, code, word in ((0, 0, ''), (0.2, BAD_INPUT, 'camera path')):
        with open(path, 'w') as f:
            f.write('from.x,from.y,from.z,to.x,to.y,to.z\n2.8,2.7,-7,2.8,2.7,0\n2.8,2.7,-7,2.8,%g,1\n' % (2.7 + to))
        if to == 0:
            seen = interrupted(tool, checks, more=views)
            continue
        process = tool.bake(seen, *views)
        checks.that(process.status == code and word in process.stderr,
                    'a changed path of a camera: %d, %s' % (process.status, process.stderr), process)
    process = tool.bake(folder, scene=os.path.join(harness.REPOSITORY, 'jobs', 'furnace.glb'))
    checks.that(process.status == BAD_INPUT and 'scene content' in process.stderr,
                'another scene was not refused: %d' % process.status, process)
    checks.that(len(generations(folder)) == 2, 'after refusals %d generations' % len(generations(folder)))
    same(checks, tool, reference, folder,
         tool.bake(folder, '--checkpoint-every', 100, '--watchdog', 9, '--quiet', threads=2), 'after refusals')
    # what changes no light on surfaces is no reason to refuse, and those keep their bits
    folder = interrupted(tool, checks)
    process = tool.bake(folder, '--half', '--no-stitch', '--denoise', 'none', '--probe-spacing', 1, '--samples-probe',
                        9)
    checks.that(process.status == 0 and 'going on from checkpoint' in process.stderr,
                'other files and probes: ended with %d' % process.status, process)
    kept = {k: v for k, v in result(folder).items() if k.startswith('kiln.h5')}
    checks.that(kept and all(reference[k] == v for k, v in kept.items()),
                'other files and probes: the points are not the same', process)
    folder = interrupted(tool, checks)
    process = tool.bake(folder, '--seed', 1, '--no-resume')
    checks.that(process.status == 0 and not os.path.exists(os.path.join(folder, 'checkpoint')),
                '--no-resume ended with %d' % process.status, process)


HOW = ('flip', 'cut', 'flip', 'flip', 'flip', 'flip', 'flip', 'remove', 'flip', 'flip', 'flip', 'flip')


def damage(dice, path, how):
    if how == 'remove':
        os.remove(path)
        return
    size = os.path.getsize(path)
    with open(path, 'r+b') as f:
        if how == 'cut':
            f.truncate(dice.randrange(size))
            return
        at = dice.randrange(size)
        f.seek(at)
        byte = f.read(1)[0]
        f.seek(at)
        f.write(bytes([byte ^ 1 << dice.randrange(8)]))


def damage_checkpoints(checks, tool, dice, rounds):
    """Files of the newest generation, and one time in eight of both."""
    kept = interrupted(tool, checks, ranks=2, after=3)
    folder, noticed = kept + '-damaged', 0
    older, newest = [int(g[-6:]) for g in generations(kept)]
    for i in range(rounds):
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(kept, folder)
        hurt = generations(folder) if i % 8 == 7 else generations(folder)[1:]
        paths = [dice.choice(sorted(glob.glob(generation + '/*'))) for generation in hurt]
        for path in paths:
            damage(dice, path, HOW[i % len(HOW)])
        process = tool.bake(folder, *(('--max-time', 0.01) if i else ()))  # to the end only once
        names = ['/'.join(path.split('/')[-2:]) for path in paths]
        missed = [name for name in names if not re.search('is not whole.*' + name, process.stderr)]
        noticed += checks.that(not missed, '%s of %s was not noticed' % (HOW[i % len(HOW)], missed), process)
        if len(hurt) == 2:
            checks.that('going on from' not in process.stderr and process.status == STOPPED,
                        'with both generations damaged it ended with %d' % process.status, process)
        else:
            # what stops while it imports says which one it keeps, before it would say what it goes on from
            used = re.search('going on from checkpoint %d,|checkpoint %d is kept' % (older, older), process.stderr)
            checks.that(used,
                        'generation %d was not used instead of %d' % (older, newest), process)
        if i == 0:
            reference, _ = reference_of(checks, tool)
            same(checks, tool, reference, folder, process, 'damaged')
    return noticed


def damage_results(checks, tool, dice, rounds):
    kept = tool.folder()
    checks.that(tool.bake(kept, threads=2).status == 0, 'a bake to be damaged')
    noticed = 0
    for i in range(rounds):
        paths = sorted(path for path in glob.glob(kept + '/**', recursive=True) if os.path.isfile(path))
        path = dice.choice(paths)
        shutil.copy2(path, kept + '.whole')
        damage(dice, path, HOW[i % len(HOW)])
        verdict = tool.run('verify', kept)
        good = verdict.status == (66 if (os.path.basename(path), HOW[i % len(HOW)]) == ('manifest', 'remove')
                                  else BAD_INPUT)
        noticed += checks.that(good and os.path.basename(path) in verdict.stdout + verdict.stderr,
                               '%s of %s: kiln verify did not name it' % (
            HOW[i % len(HOW)], path), verdict)
        os.replace(kept + '.whole', path)
    verdict = tool.run('verify', kept)
    checks.that(verdict.status == 0, 'repaired results', verdict)
    return noticed


def try_damage(checks, tool):
    seed = int(os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice, rounds = random.Random(seed), int(os.environ.get('KILN_FLIPS', '12'))
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed), flush=True)
    print('checkpoints: %d of %d damages noticed' % (damage_checkpoints(checks, tool, dice, rounds), rounds),
          flush=True)
    print('results: %d of %d damages noticed' % (damage_results(checks, tool, dice, rounds), rounds))


def try_disk(checks, tool):
    mount = os.path.join(tool.scratch, 'small')
    os.mkdir(mount)
    reference, _ = reference_of(checks, tool)
    if subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=9m', 'none', mount],
                      stderr=subprocess.DEVNULL).returncode != 0:
        harness.skip('a small file system cannot be mounted here.')
    try:
        full_disk(checks, tool, reference, mount)
        read_only(checks, tool, reference, mount)
    finally:
        subprocess.run(['umount', '-l', mount])


def full_disk(checks, tool, reference, mount):
    folder = os.path.join(mount, 'bake')
    filler = os.path.join(mount, 'filler')
    process = tool.start(folder, *OFTEN, ranks=2, log=os.path.join(tool.scratch, 'small-disk'))
    wait_for(lambda: generations(folder) or process.poll() is not None)
    process.send_signal(signal.SIGUSR1)
    status = finish(process)
    checks.that(status == STOPPED, 'on a small disk: %s' % status)
    before = [os.path.basename(g) for g in generations(folder)][-1:]
    with open(filler, 'wb', buffering=0) as f:
        try:
            while f.write(b'x' * 4096) == 4096:
                pass
        except OSError:
            pass
    process = tool.bake(folder, *OFTEN, ranks=2)
    checks.that(process.status == IO, 'on a full disk it ended with %d, not 74' % process.status, process)
    checks.that([os.path.basename(g) for g in generations(folder)][-1:] == before,
                'on a full disk the last generation went')
    os.remove(filler)
    moved = tool.folder()
    shutil.copytree(folder, moved)
    process = tool.bake(moved, ranks=2)
    checks.that('going on from checkpoint' in process.stderr, 'the last generation was not gone on from', process)
    same(checks, tool, reference, moved, process, 'after a full disk')


CALLS = ('pwrite64', 'pwritev', 'fsync', 'renameat', 'openat')


def traced(tool, folder, *words):
    line = tool.line(folder, *OFTEN, scene=SCENES[2], threads=2)
    return harness.run(['strace', '-f', '-y', '-o', folder + '.calls', *words, *line], 120, harness.MPI_ENVIRONMENT)


def calls_of(folder):
    """{call: [which of the main thread's calls of that name work on the bake's files]}, from a bake that nothing
    happened to."""
    count, found = dict.fromkeys(CALLS, 0), {call: [] for call in CALLS}
    with open(folder + '.calls', errors='replace') as f:
        lines = [line.split(None, 1) for line in f]
    for thread, words in lines:
        call = words.split('(')[0]
        if thread == lines[0][0] and call in CALLS:
            count[call] += 1
            if call not in ('openat', 'renameat') or folder in words:
                found[call].append(count[call])
    return found


def try_faults(checks, tool, failures=('ENOSPC', 'EDQUOT', 'EIO', 'EINTR')):
    """The k-th call of a kind fails: the bake ends with 71, 73 or 74 or need not care, all files can be read, and the
    same command goes on to the same bits."""
    if shutil.which('strace') is None:
        harness.skip('strace is not installed.')
    rounds, seed = int(os.environ.get('KILN_FAULTS', '20')), int(
        os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice, ends = random.Random(seed), {}
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed), flush=True)
    whole = tool.folder()
    process = traced(tool, whole, '-e', 'trace=' + ','.join(CALLS))
    if not checks.that(process.status == 0, 'a traced bake ended with %d' % process.status, process):
        checks.end()
    reference, calls = result(whole), calls_of(whole)
    for i in range(rounds):
        folder, call, failure = tool.folder(), CALLS[i % len(CALLS)], dice.choice(failures)
        fault = '%s:error=%s:when=%d' % (call, failure, dice.choice(calls[call]))
        process = traced(tool, folder, '-e', 'trace=' + call, '-e', 'inject=' + fault)
        bad = readable(folder)
        checks.that(not bad, '%s: %s' % (fault, '; '.join(bad)), process)
        checks.that(process.status in ((0,) if failure == 'EINTR' else (0, SYSTEM, CANNOT_CREATE, IO)),
                    '%s: ended with %d' % (fault, process.status), process)
        ends[process.status] = ends.get(process.status, 0) + 1
        if process.status != 0:
            process = tool.bake(folder, scene=SCENES[2], threads=2)
        if checks.that(process.status == 0, '%s: going on ended with %d' % (fault, process.status), process):
            different = differences(reference, result(folder))
            checks.that(not different, '%s: not the same: %s' % (fault, different), process)
        shutil.rmtree(folder, ignore_errors=True)
    print('%d faults; ended with: %s' % (rounds, ', '.join('%d: %d times' % end for end in sorted(ends.items()))))


def try_interrupted(checks, tool):
    try_faults(checks, tool, ('EINTR',))


def read_only(checks, tool, reference, mount):
    shutil.rmtree(os.path.join(mount, 'bake'), ignore_errors=True)
    folder = os.path.join(mount, 'other')
    log = os.path.join(tool.scratch, 'other')
    process = tool.start(folder, *OFTEN, ranks=2, log=log)
    wait_for(lambda: generations(folder) or process.poll() is not None)
    remounted = wait_for(lambda: subprocess.run(['mount', '-o', 'remount,ro', mount],
                                                stderr=subprocess.DEVNULL).returncode == 0, 5)
    status = finish(process)
    if remounted:
        checks.that(status in (CANNOT_CREATE, IO), 'on a read-only disk it ended with %s, not 73 or 74: %s' %
                    (status, text(log)[-300:]))
        subprocess.run(['mount', '-o', 'remount,rw', mount])
    moved = tool.folder()
    shutil.copytree(folder, moved)
    same(checks, tool, reference, moved, tool.bake(moved, ranks=2), 'after a read-only disk')


LIMIT = ('--watchdog', 2)
# Where a rank of three stops itself (KILN_HALT_RANK).
HALTS = ('1:import', '2:exchange', '0:writing a checkpoint', '1:lightmaps', '2:kiln.h5', '0:volume.hdf', '2:preview',
         '1:end')
SOME_HALTS = ('2:exchange', '0:writing a checkpoint', '1:lightmaps', '0:volume.hdf')  # without --full


def lost(checks, process, folder, rank, what):
    """A rank stands still: whether the others say so within the limit and some seconds, and the job is gone."""
    began = time.monotonic()
    status = finish(process)
    seconds, said = time.monotonic() - began, text(folder)
    checks.that(status == LOST, '%s: ended with %s, not 76: %s' % (what, status, said[-400:]))
    checks.that(seconds < 15, '%s: noticed after %.1f s' % (what, seconds))
    named = 'rank %d on ' % rank in said and 'no sign of life' in said
    checks.that(named or 'does not come to its end' in said, '%s: not named: %s' % (what, said[-400:]))
    checks.that(wait_for(lambda: not ranks_of(process), 5), '%s: processes are left' % what)
    return seconds, named


def try_watchdog(checks, tool):
    """A rank stands still: in the midst of a long pass, and at places that ranks tell the watchdog of (--full: all)."""
    for stopped in (1, 0) if tool.full else (1,):
        for samples in (4096, 4 * 4096, 16 * 4096, 64 * 4096):  # as many as take long on this machine
            long, folder = ('--samples-indirect', samples), tool.folder()
            process = tool.start(folder, *OFTEN, *LIMIT, *long, ranks=3)
            wait_for(lambda: generations(folder) or process.poll() is not None)
            ranks = ranks_of(process)  # in the order in which they were started
            if len(ranks) == 3:
                break
            finish(process)
        if not checks.that(len(ranks) == 3, 'the bake ended before a rank could be stopped'):
            checks.end()
        os.kill(ranks[stopped], signal.SIGSTOP)
        _, named = lost(checks, process, folder, stopped, 'rank %d stopped' % stopped)
        checks.that(named, 'rank %d stopped: not named: %s' % (stopped, text(folder)[-400:]))
        reference, _ = reference_of(checks, tool, *long)
        same(checks, tool, reference, folder, tool.bake(folder, *long, ranks=2), 'after rank %d stood still' % stopped)
    reference, _ = reference_of(checks, tool)
    for halt in HALTS if tool.full else SOME_HALTS:
        folder, rank = tool.folder(), int(halt.split(':')[0])
        os.environ['KILN_HALT_RANK'] = halt
        process = tool.start(folder, *OFTEN, *LIMIT, '--preview', ranks=3)
        del os.environ['KILN_HALT_RANK']
        wait_for(lambda: any(state_of(pid) == 'T' for pid in ranks_of(process)) or process.poll() is not None,
                 pause=LOOK)
        _, named = lost(checks, process, folder, rank, halt)
        checks.that(named, '%s: not named: %s' % (halt, text(folder)[-400:]))
        if halt[2:] in (('writing a checkpoint', 'lightmaps', 'volume.hdf') if tool.full else ('volume.hdf',)):
            same(checks, tool, reference, folder, tool.bake(folder, ranks=2), 'after ' + halt)


def try_halts(checks, tool):
    """SIGSTOP to a random rank of three at random moments, a quarter of them each while checkpoints and results are
    written."""
    halts, seed = int(os.environ.get('KILN_HALTS', '20')), int(
        os.environ.get('KILN_SEED', str(random.randrange(1 << 30))))
    dice, done, named, slowest = random.Random(seed), 0, 0, 0
    print('seed %d (KILN_SEED=%d repeats it)' % (seed, seed), flush=True)
    subject = Subject(checks, tool, SCENE)
    while done < halts:
        folder, began, rank = tool.folder(), time.time(), dice.randrange(3)
        process = tool.start(folder, *OFTEN, *LIMIT, ranks=3)
        wait_for(lambda: process.poll() is not None or b'"running"' in status_bytes(folder))
        ranks = ranks_of(process)
        what = take_aim(dice, (WHENEVER, CHECKPOINT, WHENEVER, RESULTS)[done % 4], subject, process, folder, began)
        try:
            os.kill(ranks[rank], signal.SIGSTOP)
        except (IndexError, ProcessLookupError):
            finish(process)
            continue  # it was done
        if wait_for(lambda: state_of(ranks[rank]) in 'TZ', 5) and state_of(ranks[rank]) == 'T':
            seconds, name = lost(checks, process, folder, rank, 'rank %d stopped %s' % (rank, what))
            done, named, slowest = done + 1, named + name, max(slowest, seconds)
        finish(process)
        bad = readable(folder)
        checks.that(not bad, '%s: %s' % (what, '; '.join(bad)))
        same(checks, tool, subject.reference, folder, tool.bake(folder, ranks=2), what)
        shutil.rmtree(folder, ignore_errors=True)
    print('%d stops, noticed within %.1f s; in %d of them the rank was named' % (done, slowest, named))


def try_cost(checks, tool):
    """Least seconds of the same bake with and without checkpoints, in turn."""
    for ranks in (0, 2):
        seconds = {'0': [], '300': [], '1': []}
        for _ in range(3):
            for every in seconds:
                folder = tool.folder()
                process = tool.bake(folder, '--checkpoint-every', every, '--lightmap-size', 128, '--samples-indirect',
                                    1024, ranks=ranks, threads=1 if ranks else 2)
                seconds[every].append(process.seconds)
                shutil.rmtree(folder)
        base = min(seconds['0'])
        for every, values in seconds.items():
            print('%d ranks, --checkpoint-every %s: %.2f s, %+.1f %%' %
                  (max(ranks, 1), every, min(values), 100 * (min(values) / base - 1)))


PARTS = {'kills': try_kills, 'ends': try_ends, 'layouts': try_layouts, 'local': try_local, 'quantities': try_quantities,
         'blocks': try_blocks, 'range': try_range, 'guide': try_guide, 'caustics': try_caustics,
         'landing': try_landing, 'sharing': try_sharing, 'growing': try_growing,
         'crossing': try_crossing, 'paths': try_paths, 'bounces': try_bounces, 'signals': try_signals,
         'phases': try_phases,
         'refusals': try_refusals, 'damage': try_damage, 'disk': try_disk, 'faults': try_faults,
         'interrupted': try_interrupted,
         'warnings': try_warnings, 'watchdog': try_watchdog, 'halts': try_halts, 'cost': try_cost}


def main():
    arguments, kiln = harness.start(__doc__, lambda parser: parser.add_argument('part', choices=sorted(PARTS)),
                                    lambda parser: parser.add_argument('--full', action='store_true',
                                                                       help='every place and signal'))
    checks = harness.Checks()
    PARTS[arguments.part](checks, Tool(kiln.path, kiln.scratch, arguments.full))
    checks.end()


if __name__ == '__main__':
    main()
