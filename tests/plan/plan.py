"""What kiln plan says against what a bake then takes; what kiln verify notices; what kiln bench scaling leaves.

    plan.py prediction | prediction_full | landing | gathered | uncaustic | balance | verify | scaling

What looks at seconds (prediction_full, balance) is run by hand: on a machine that others use it may fail.
"""
import json
import os
import random
import resource
import shutil
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402
from reading import run_json  # noqa: E402

MEMORY, DISK = 0.10, 0.10
# The factor by which a predicted time may be wrong. On a quiet machine it is 1.2 to 1.4; so wide, because both the
# sample that plan measures and the bake share cores and their memory with whatever else runs. What it is there to
# notice: a pass, bounces or samples counted twice or not at all, seconds taken for those of one thread, a unit.
TIME = 2.5
# What few samples change is seconds. A count makes the others of `draft` counts too; without one it is an error, whose
# rounds of samples nobody knows before.
FEW = ['--quality', 'draft', '--samples-direct', 64, '--samples-probe', 4, '--bounces', 2]
CITY = 60000  # triangles; where seconds do not count, a third
# s of a thread for a point: its radius is found and its light spread, in 12 passes
# (coordinator/integrate/land/merge.h).
SPREADING = 12 * 2e-7
FLIPS = int(os.environ.get('KILN_FLIPS', '48'))
UNEVEN = 0.15  # of the mean
TRIES = 4


def run(kiln, *arguments, ranks=1, code=0):
    command = [kiln, *map(str, arguments)]
    if ranks > 1:
        command = ['mpirun', '-n', str(ranks), *command]
    done = subprocess.run(command, env={**harness.MPI_ENVIRONMENT, **os.environ}, stdin=subprocess.DEVNULL,
                          capture_output=True, text=True, timeout=280)
    assert done.returncode == code, '%s: %d instead of %d\n%s' % (' '.join(command), done.returncode, code, done.stderr)
    return done.stdout


def folder_bytes(folder):
    return sum(os.path.getsize(os.path.join(at, name)) for at, _, names in os.walk(folder) for name in names)


def bake_seconds(kiln, path, out, ranks, options):
    """Bakes; (run.json, seconds of processor time of all ranks). The ranks' parent waits for them, so all of it is
    counted."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    shutil.rmtree(out, ignore_errors=True)
    run(kiln, 'bake', path, '-o', out, '--quiet', *options, ranks=ranks)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    report = run_json(out)
    return report, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def time_off(predicted, report, processor, ranks):
    """By which factor a predicted time is wrong, one way or the other. On a quiet machine a bake takes about its
    processor time over the number of its threads; where others use the cores, it takes longer. What lies between the
    two is right."""
    threads = min(len(os.sched_getaffinity(0)), ranks * report['threads'])
    least, most = sorted((processor / threads, report['seconds']))
    return max(least / predicted, predicted / most, 1.0)


def prediction(kiln, folder, full=False):
    """Three scenes: memory, of which the highest of some bakes counts, and disk; full: also time, of which the best of
    some tries counts, with all samples."""
    failures, settings = [], [] if full else FEW
    for scene, options, ranks in [('cornell', [], 1), ('rooms', ['--columns', 3, '--rows', 2], 2),
                                  ('city', ['--triangles', CITY if full else CITY // 3], 1)]:
        path, out, wrong = os.path.join(folder, scene + '.glb'), os.path.join(folder, scene), []
        run(kiln, 'generate', scene, '-o', path, *options)
        report, processor = bake_seconds(kiln, path, out, ranks, settings)
        peak = report['memory']['peak_rank']
        while len(wrong) < (3 if full else 1) and min(wrong, default=TIME + 1) > TIME:
            plan = json.loads(run(kiln, 'plan', path, '--ranks', ranks, '--ranks-per-node', ranks, '--json',
                                  *settings))
            wrong.append(time_off(plan['seconds']['total'], report, processor, ranks))
        planned, tries = plan['memory_per_rank']['total'], 1
        while abs(planned / peak - 1) > MEMORY and tries < 3:  # where threads hardly overlap, they take less at a time
            again, _ = bake_seconds(kiln, path, out, ranks, settings)
            peak, tries = max(peak, again['memory']['peak_rank']), tries + 1
        off = {'memory': planned / peak - 1,
               'disk': plan['disk_bytes']['total'] / folder_bytes(out) - 1}
        print('%-8s on %d: memory %+5.1f %%, disk %+5.1f %%, time %.1f s, taken %.1f s and %.1f s of processors, '
              'wrong by %s' % (
            scene, ranks, 100 * off['memory'], 100 * off['disk'], plan['seconds']['total'], report['seconds'],
            processor,
            ', '.join('%.2f' % w for w in wrong)))
        assert plan['points'] == report['points']['count'] and plan['seconds']['calibration'] <= 30
        for what, most in (('memory', MEMORY), ('disk', DISK)):
            if abs(off[what]) > most:
                failures.append('%s: %s is %+.1f %% off' % (scene, what, 100 * off[what]))
        if full and min(wrong) > TIME:
            failures.append('%s: time is wrong by a factor of %.2f in the best of %d tries' %
                            (scene, min(wrong), len(wrong)))
    assert not failures, '; '.join(failures)


def prediction_full(kiln, folder):
    prediction(kiln, folder, full=True)


def landing(kiln, folder):
    """Light paths that land and are merged, on two ranks: what they add to processor time and memory."""
    path, out = os.path.join(folder, 'spheres.glb'), os.path.join(folder, 'spheres')
    run(kiln, 'generate', 'cornell-spheres', '-o', path)
    few = ['--quality', 'draft', '--samples-direct', 64, '--samples-probe', 0, '--bounces', 0, '--materials', 'auto',
           '--backend', 'embree', '--texels-per-metre', 16, '--threads', 1]
    paths = ['--caustics', 'merge', '--photons', 400000, '--iterations', 3]
    plan = json.loads(run(kiln, 'plan', path, '--ranks', 2, '--ranks-per-node', 2, '--json', *few, *paths))
    without, before = bake_seconds(kiln, path, out, 2, [*few, '--caustics', 'none'])
    report, after = bake_seconds(kiln, path, out, 2, [*few, *paths])
    seconds, taken = 2 * plan['seconds']['caustics'], after - before
    memory = plan['memory_per_rank']['total'] / report['memory']['peak_rank'] - 1
    print('light paths: %.2f s of processors, taken %.2f s; memory %+.1f %%' % (seconds, taken, 100 * memory))
    landed = plan['landing']
    assert (landed['photons'], landed['iterations'], landed['aims']) == (
        400000, 3, report['materials']['aims']), landed
    assert 1 / TIME < seconds / taken < TIME and abs(memory) < 0.2
    # 32 bytes of each path that lands, half of them at the other rank, half of them from each
    assert abs(landed['bytes_sent_an_iteration'] / (32 * 400000 * landed['landed'] / 4) - 1) < 1e-6
    assert 0.2 < landed['landed'] < 1
    # shared with gather rays, of which most are spent on the points; pilots are as many paths as an iteration
    paths = ['--caustics', 'vcm', '--photons', 100000, '--iterations', 1, '--samples-indirect', 64]
    plan = json.loads(run(kiln, 'plan', path, '--ranks', 1, '--json', *few, *paths))
    _, before = bake_seconds(kiln, path, out, 1, [*few, '--caustics', 'none'])
    _, after = bake_seconds(kiln, path, out, 1, [*few, *paths])
    seconds, taken, landed = plan['seconds']['caustics'], after - before, plan['landing']
    print('light paths and rays: %.2f s of processors, taken %.2f s' % (seconds, taken))
    assert 1 / TIME < seconds / taken < TIME
    points = (landed['seconds_a_point_gathered'] + SPREADING) * plan['points']
    assert abs(landed['seconds_of_one_rank'] / (200000 * landed['seconds_a_path'] + points) - 1) < 0.2
    # and what crosses the spheres of probes
    few = [*few, '--samples-probe', 16, '--probe-spacing', 0.4]
    paths = ['--caustics', 'land', '--photons', 200000, '--iterations', 2]
    plan = json.loads(run(kiln, 'plan', path, '--ranks', 1, '--json', *few, *paths))
    _, before = bake_seconds(kiln, path, out, 1, [*few, *paths, '--samples-probe', 0])
    _, after = bake_seconds(kiln, path, out, 1, [*few, *paths])
    seconds, taken = plan['seconds']['probes'], after - before
    print('light paths at probes: %.2f s of processors, taken %.2f s' % (seconds, taken))
    assert 1 / TIME < seconds / taken < TIME and plan['landing']['seconds_of_one_rank_for_probes'] > 0.2 * taken


def check_paths_left_out(kiln, folder, caustics, more=()):
    """What a bake takes for whose caustics no light path is traced; plan knows of no preview that is left out."""
    path, out = os.path.join(folder, 'spheres.glb'), os.path.join(folder, 'spheres')
    run(kiln, 'generate', 'cornell-spheres', '-o', path)
    few = ['--quality', 'draft', '--samples-direct', 64, '--samples-probe', 0, '--bounces', 1, '--materials', 'auto',
           '--backend', 'embree', '--texels-per-metre', 8, '--threads', 1, '--caustics', caustics]
    plan = json.loads(run(kiln, 'plan', path, '--ranks', 1, '--json', *few))
    report, processor = bake_seconds(kiln, path, out, 1, [*few, *more])
    disk = plan['disk_bytes']['total'] - (plan['disk_bytes']['preview'] if more else 0)
    off = {'memory': plan['memory_per_rank']['total'] / report['memory']['peak_rank'] - 1,
           'disk': disk / folder_bytes(out) - 1}
    print('%s: memory %+.1f %%, disk %+.1f %%, caustics %.2f s of %.2f s taken' % (
        caustics, 100 * off['memory'], 100 * off['disk'], plan['seconds']['caustics'], processor))
    assert plan['points'] == report['points']['count'] and 'landing' not in plan, plan
    assert plan['memory_per_rank']['landing'] == 0 and report['materials']['caustics'] == caustics
    assert abs(off['disk']) < DISK, off
    return plan, report, off


def gathered(kiln, folder):
    plan, report, off = check_paths_left_out(kiln, folder, 'gather')
    assert abs(off['memory']) < MEMORY, off
    # as many rays of a point as it has in the final gather
    assert report['rays']['caustics'] == report['rays']['final'] > 0 and plan['seconds']['caustics'] > 0


def uncaustic(kiln, folder):
    plan, report, _ = check_paths_left_out(kiln, folder, 'none', ['--no-preview'])
    assert plan['seconds']['caustics'] == 0 and report['rays']['caustics'] == 0


def judged(report):
    """What was thought of the shares after the first bounce, by what its points had cost."""
    return next(b['rebalance'] for b in report['bounces'] if b['kind'] == 'bounce')


def compare_balance(kiln, path, out, ranks, ways):
    """Predicted and measured: unevenness in the first bounce, over the mean, and whether the points were then
    repartitioned."""
    options = ['--threads', 1, '--quality', 'draft', '--samples-direct', 64, '--lightmap-max', 192, '--bounces', 4,
               '--samples-probe', 0, *ways]
    plan = json.loads(run(kiln, 'plan', path, '--ranks', ranks, '--ranks-per-node', ranks, '--json', *options))[
        'balance']
    shutil.rmtree(out, ignore_errors=True)
    run(kiln, 'bake', path, '-o', out, '--quiet', *options, ranks=ranks)
    report = run_json(out)
    first = judged(report)
    return plan, first, [b['rebalance'] for b in report['bounces']
                         if b['rebalance']], [b['stolen_points'] for b in report['bounces']]


def balance(kiln, folder):
    """An uneven scene, and an even one with a slow rank. Other work on the machine makes ranks uneven that are not: the
    best of some tries counts. Ranks that share a core wait for each other at random: there are no more ranks than
    cores."""
    cores = len(os.sched_getaffinity(0))
    statue, even, out = (os.path.join(folder, name) for name in ('statue.glb', 'even.glb', 'out'))
    run(kiln, 'generate', 'cornell-statue', '-o', statue)
    run(kiln, 'generate', 'cornell', '-o', even)
    failures = []
    alone = ['--shared-memory-ranks', 1]
    for name, path, ranks, slow, ways in [('uneven', statue, 2, '', alone), ('uneven', statue, 3, '', alone),
                                          ('uneven', statue, 4, '', alone), ('slow rank', even, 2, '1:3', alone),
                                          ('helped', statue, 2, '', [])]:
        if ranks > cores:
            print('%-9s on %d: not on %d cores' % (name, ranks, cores))
            continue
        os.environ['KILN_SLOW_RANK'] = slow
        best = None
        for _ in range(TRIES):
            plan, first, later, given = compare_balance(kiln, path, out, ranks, ways)
            off = abs(plan['first_pass']['bounce'] - first['imbalance'])
            if best is None or off < best[0]:
                best = off, plan, first, later, given
            if best[0] <= UNEVEN / 3:
                break
        off, plan, first, later, given = best
        print('%-9s on %d: first bounce %4.1f %%, measured %4.1f %%; last bounce %4.1f %%, measured %4.1f %%; in all '
              '%4.1f %%, kept %4.1f %%; '
              'repartitioned %d times, measured %d; %d points stolen' % (
                  name, ranks, 100 * plan['first_pass']['bounce'], 100 * first['imbalance'],
                  100 * plan['last_pass']['bounce'],
                  100 * later[-1]['imbalance'], 100 * plan['imbalance'], 100 * plan['imbalance_kept'],
                  plan['repartitions'],
                  sum(b['moved'] for b in later),
                  sum(given)))
        if off > UNEVEN:
            failures.append('%s on %d ranks: %.2f instead of %.2f' %
                            (name, ranks, plan['first_pass']['bounce'], first['imbalance']))
        if slow and not (plan['repartitions'] > 0 and first['moved']):
            failures.append('%s: repartitioned %d times, %s' % (name, plan['repartitions'], first))
        if not ways and (plan['imbalance'] > 0.6 * plan['imbalance_kept'] or sum(given) == 0):
            failures.append('%s: uneven by %.2f, kept by %.2f, %d points stolen' %
                            (name, plan['imbalance'], plan['imbalance_kept'], sum(given)))
    del os.environ['KILN_SLOW_RANK']
    assert not failures, '; '.join(failures)


def read_everything(folder):
    """Seconds to decode every value, as whoever uses the results does."""
    import exr
    import h5py
    start = time.monotonic()
    for at, _, names in os.walk(folder):
        for name in names:
            path = os.path.join(at, name)
            if name.endswith('.exr'):
                exr.read(path)
            elif name.endswith(('.h5', '.hdf')):
                with h5py.File(path) as file:
                    file.visititems(lambda _, item: item[()] if isinstance(item, h5py.Dataset) else None)
            else:
                with open(path, 'rb') as file:
                    file.read()
    return time.monotonic() - start


def verify(kiln, folder):
    scene, out, seed = os.path.join(folder, 'cornell.glb'), os.path.join(folder, 'out'), random.randrange(1 << 30)
    print('seed %d' % seed)
    chance = random.Random(seed)
    run(kiln, 'generate', 'cornell', '-o', scene)
    run(kiln, 'bake', scene, '-o', out, '--quiet', '--quality', 'draft', '--samples-direct', 64,
        '--texels-per-metre', 8)
    run(kiln, 'verify', out)
    files = [os.path.join(at, name) for at, _, names in os.walk(out) for name in names]
    for i in range(FLIPS):
        path = files[i % len(files)]
        at, bit = chance.randrange(os.path.getsize(path)), chance.randrange(8)
        with open(path, 'r+b') as file:
            byte = (file.seek(at), file.read(1))[1][0]
            file.seek(at)
            file.write(bytes([byte ^ 1 << bit]))
            file.flush()
            answer = run(kiln, 'verify', out, code=65)
            file.seek(at)
            file.write(bytes([byte]))
        assert os.path.basename(path) in answer or os.path.basename(path) == 'manifest', answer
    for path in files:  # gone, and cut off
        os.rename(path, path + '.aside')
        run(kiln, 'verify', out, code=66 if os.path.basename(path) == 'manifest' else 65)
        shutil.copy(path + '.aside', path)
        os.truncate(path, os.path.getsize(path) // 2)
        run(kiln, 'verify', out, code=65)
        os.replace(path + '.aside', path)
    answer = run(kiln, 'verify', out)
    print('%d flipped bits, %d files gone or cut off: all noticed; %s' % (FLIPS, len(files), answer.strip()))


def cost(kiln, folder):
    """Not run by ctest: verify against reading on a bake of some size."""
    scene, out = os.path.join(folder, 'city.glb'), os.path.join(folder, 'out')
    run(kiln, 'generate', 'city', '-o', scene, '--triangles', 200000)
    run(kiln, 'bake', scene, '-o', out, '--quiet', '--quality', 'draft', '--samples-direct', 64,
        '--bounces', 1)
    seconds = []
    for _ in range(3):
        start = time.monotonic()
        run(kiln, 'verify', out)
        seconds.append((time.monotonic() - start, read_everything(out)))
    own, reading = (min(s[i] for s in seconds) for i in range(2))
    print('%.1f MiB: verify %.3f s, reading every value %.3f s' % (folder_bytes(out) / 2**20, own, reading))


def processes_of(session):
    """Command lines of what runs in a session."""
    found = []
    for process in filter(str.isdigit, os.listdir('/proc')):
        try:
            if os.getsid(int(process)) == session:
                with open('/proc/%s/cmdline' % process) as file:
                    found.append(file.read().replace('\0', ' '))
        except OSError:
            pass
    return found


def ended_bench(kiln, scene, folder):
    """A bench that is told to end takes the bake along."""
    command = [kiln, 'bench', 'scaling', scene, '--ranks', '2,3', '--quality', 'production', '--quiet', '-o',
               os.path.join(folder, 'made', 'too')]
    bench = subprocess.Popen(command, env={**harness.MPI_ENVIRONMENT, **os.environ}, stdin=subprocess.DEVNULL,
                             stderr=subprocess.PIPE, text=True,
                             start_new_session=True)
    end = time.monotonic() + 30
    while not any('kiln bake' in line and not line.startswith('mpirun') for line in processes_of(bench.pid)):
        assert time.monotonic() < end and bench.poll() is None, 'no bake was begun'
        time.sleep(0.1)
    bench.terminate()
    words = bench.communicate(timeout=30)[1]
    assert bench.returncode == 75 and 'stopped by' in words, (bench.returncode, words)
    end = time.monotonic() + 5
    while processes_of(bench.pid):
        assert time.monotonic() < end, 'left behind: %s' % processes_of(bench.pid)
        time.sleep(0.1)


def scaling(kiln, folder):
    scene, out = os.path.join(folder, 'rooms.glb'), os.path.join(folder, 'scaling')
    run(kiln, 'generate', 'rooms', '-o', scene)
    answer = json.loads(run(kiln, 'bench', 'scaling', scene, '--ranks', '1,2', '--quality', 'draft',
                            '--samples-direct', 64, '--texels-per-metre', 4, '--bounces', 1, '-o', out, '--json'))
    runs = answer['runs']
    assert [(r['kind'], r['ranks']) for r in runs] == [('strong', 1), ('strong', 2), ('weak', 1), ('weak', 2)]
    assert runs[1]['points'] == runs[0]['points'] and 1.6 < runs[3]['points'] / runs[2]['points'] < 2.4
    assert runs[0]['efficiency'] == 1
    with open(os.path.join(out, 'scaling.csv')) as file:
        assert len(file.read().splitlines()) == 5
    with open(os.path.join(out, 'scaling.svg')) as file:
        assert file.read().count('<polyline') == 4
    run(kiln, 'bench', 'scaling', scene, '--ranks', '2,1', code=64)
    ended_bench(kiln, scene, folder)
    curves = os.path.join(folder, 'curves')
    plan = json.loads(run(kiln, 'plan', scene, '--quality', 'draft', '--texels-per-metre', 4, '--ranks', 100000,
                          '--ranks-per-node', 8, '--points', 10**9,
                          '--json', '-o', curves))
    for kind in ('strong', 'weak'):
        curve = plan[kind + '_scaling']
        assert curve[0]['ranks'] == 1 and curve[-1]['ranks'] == 100000 and curve[-1]['nodes'] == 12500
        assert abs(curve[0]['points'] / 1e9 - 1) < 1e-6 and all(0 < c['efficiency'] <= 1.0001 for c in curve)
    assert len(os.listdir(curves)) == 2
    print(answer['strong'])


if __name__ == '__main__':
    arguments = sys.argv[1:]
    at = arguments.index('--kiln')
    program = os.path.abspath(arguments[at + 1])
    del arguments[at:at + 2]
    with tempfile.TemporaryDirectory() as place:
        {'prediction': prediction, 'prediction_full': prediction_full, 'landing': landing,
         'gathered': gathered, 'uncaustic': uncaustic, 'balance': balance, 'verify': verify,
         'cost': cost, 'scaling': scaling}[arguments[0]](program, place)
