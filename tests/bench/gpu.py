"""Rays per second of whole bounce passes on a GPU, by traversal and scene, and one bake over several GPUs; what pairs
of patches, links and states of kept rays take; rays of light paths that land, and of gathers with gloss and without.

  /usr/bin/python3 tests/bench/gpu.py --kiln build/release/kiln [--gpus 1 2 4] [--only rates scaling pairs visibility
      states links gloss]

The aims on one H200 are 8, 2.5 and 2.0 billion rays a second in the Cornell box, at 250 thousand and at 4 million
triangles. The bake is the city's, at least 16 million points; its table shows what of each pass the devices were busy.
All pairs of 768 x 768 texels are to take 60 s a bounce; what grids and kept visibility add or save is of two bounces. A
state of 3 million points 20 ms, of sixteen at once 10.
Links are of the statue's box with as many texels as 256 x 256 and 1024 x 1024: a bounce in which they are found, one
in which they are added up, and a relight from them. With gloss, light paths that land are to trace 0.4 times the rays a
second of the gather.
"""
import json
import os
import subprocess
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

SCENES = (('Cornell box', ('cornell',), 100, 8.0),
          ('statue, 250 thousand', ('cornell-statue', '--triangles', 250000), 100, 2.5),
          ('city, 4 million', ('city', '--triangles', 4000000), 2.5, 2.0))
TRAVERSALS = ('four', 'eight', 'pipeline')


def rates(kiln, made):
    table = harness.Table(('scene', 22), ('traversal', 10), ('Grays/s', 8), ('tracer alone', 12), ('aim', 5))
    for name, _, density, aim in SCENES:
        for traversal in TRAVERSALS:
            kiln.environment['KILN_TRAVERSAL'] = traversal
            p = kiln.command('bench', 'rays', made[name], '--json', '--quiet', '--backend', 'vulkan',
                             '--texels-per-metre', density, '--samples-indirect', 256, '--repeats', 3, timeout=1800)
            if p.status != 0:
                table.row(name, traversal, '-', p.sentence()[:60], '')
                continue
            r = p.json()
            table.row(name, traversal, '%.2f' % (r['pass_mrays_per_second'] / 1e3),
                      '%.2f' % (r['tracer_mrays_per_second'] / 1e3), '%.1f' % aim)
    del kiln.environment['KILN_TRAVERSAL']


def scaling(kiln, scene, gpus):
    table = harness.Table(('GPUs', 6), ('pass', 12), ('seconds', 9), ('device', 9), ('idle', 7), ('speed-up', 9))
    first = {}
    for n in gpus:
        bake = kiln.bake(scene, '--texels-per-metre', 2.7, '--samples-direct', 64, '--samples-bounce', 16,
                         '--samples-indirect', 1024,
                         '--samples-probe', 0, '--bounces', 4, ranks=n, timeout=3600)
        if bake.process.status != 0:
            sys.exit('%s\nended with %d: %s' % (bake.process.line(), bake.process.status, bake.process.sentence()))
        for p in bake.run['bounces']:
            name = '%s %d' % (p['kind'], p['bounce'])
            first.setdefault(name, p['seconds'])
            table.row(n, name, '%.3f' % p['seconds'], '%.3f' % p['device_seconds'],
                      '%.0f %%' % (100 * (1 - p['device_seconds'] / p['seconds'])),
                      '%.2f' % (first[name] / p['seconds']))
        bake.remove()


def pairs(kiln, scene):
    """A bounce of all pairs: rays to nodes that face each other, and as many seconds as 768 x 768 texels would take.
    The last has as many points."""
    table = harness.Table(('points', 9), ('pairs', 8), ('rays', 8), ('device, s', 9), ('Grays/s', 8), ('768^2, s', 8))
    for density in (10, 20, 57):
        bake = kiln.bake(scene, '--method', 'radiosity', '--bounces', 1, '--texels-per-metre', density,
                         '--samples-direct', 16, '--samples-indirect', 64, '--samples-probe', 0, '--denoise', 'none',
                         '--no-export', timeout=3600)
        if bake.process.status != 0:
            sys.exit('%s\nended with %d: %s' % (bake.process.line(), bake.process.status, bake.process.sentence()))
        points, rays = bake.run['points']['count'], bake.run['rays']['bounces']
        seconds = sum(b['device_seconds'] for b in bake.run['bounces'] if b['kind'] != 'direct')
        table.row(points, '%.2g' % points**2, '%.2g' % rays, '%.3f' % seconds, '%.2f' % (rays / seconds / 1e9),
                  '%.1f' % (seconds * (768 * 768 / points)**2))
        bake.remove()


def visibility(kiln, scene, density=20):
    """Two bounces of all pairs, by who says what they see: rays in all, seconds of the device bounce by bounce, what is
    kept, and by how much the sum of all light differs from that by rays."""
    table = harness.Table(('options', 44), ('rays', 8), ('1st, s', 7), ('2nd, s', 7), ('GiB', 6), ('light', 8))
    by_rays = None
    for more in ((), ('--visibility', 'voxels:64'), ('--visibility-cache', 24),
                 ('--visibility-cache', 0.5)):
        bake = measure.must(kiln.bake(scene, '--method', 'radiosity', '--bounces', 2, '--texels-per-metre', density,
                                      '--samples-direct', 16, '--samples-indirect', 64, '--samples-probe', 0,
                                      '--denoise', 'none', '--no-export', *more, timeout=3600))
        seconds = [b['device_seconds'] for b in bake.run['bounces'] if b['kind'] != 'direct']
        light = (bake.points.total.T @ bake.points.area).sum()
        by_rays = light if by_rays is None else by_rays
        table.row(' '.join(map(str, more)), '%.2g' % bake.run['rays']['bounces'], '%.3f' % seconds[0],
                  '%.3f' % seconds[1], '%.2f' % (bake.run.get('visibility_cache', {}).get('bytes', 0) / 2**30),
                  '%+.1e' % (light / by_rays - 1))
        bake.remove()


def states(kiln, scene):
    """States from rows that stay on the device: seconds of the clock, loading and writing apart. The device idles while
    files are written, and begins at its idle clocks; so one state is also asked for again and again, which writes
    nothing: the last of those."""
    kept = kiln.bake(scene, '--texels-per-metre', 126, '--samples-direct', 16, '--samples-bounce', 64,
                     '--samples-indirect', 256, '--samples-probe', 0, '--denoise', 'none', '--no-export', '--materials',
                     'diffuse', '--bounces', 3, '--keep-transport', 'rows', timeout=3600)
    if kept.process.status != 0:
        sys.exit('%s\nended with %d: %s' % (kept.process.line(), kept.process.status, kept.process.sentence()))
    table = harness.Table(('points', 9), ('states', 6), ('load, s', 8), ('solve, s', 9), ('device, s', 9),
                          ('MB back', 8), ('write, s', 8))
    for count in (1, 16):
        folder = os.path.join(kiln.scratch, 'states%d' % count)
        with open(folder + '.yaml', 'w') as file:
            json.dump({'s%d' % i: {'materials': {'*': {'emission-scale': 0.5 + 0.1 * i}}} for i in range(count)}, file)
        p = kiln.command('relight', kept.directory, '--states', folder + '.yaml', '-o', folder, '--quiet', timeout=3600)
        if p.status != 0:
            sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
        with open(os.path.join(folder, 'states.json')) as file:
            said = json.load(file)
        mean = lambda key: sum(s[key] for s in said['states']) / count
        table.row(kept.run['points']['count'], count, '%.2f' % said['load_seconds'], '%.4f' % mean('solve_seconds'),
                  '%.4f' % mean('solve_device_seconds'), '%.1f' % (mean('returned_bytes') / 1e6),
                  '%.3f' % mean('write_seconds'))
    lines = 20 * (json.dumps({'materials': {'*': {'emission-scale': 0.75}}}) + '\n')
    line = [kiln.path, 'relight', kept.directory, '--listen', '--backend', 'vulkan', '--quiet', '-o',
            os.path.join(kiln.scratch, 'again')]
    said = json.loads(subprocess.run(line, input=lines, stdout=subprocess.PIPE, text=True, check=True, timeout=3600,
                                     env={**os.environ, **kiln.environment})
                      .stdout.splitlines()[-1])
    table.row(kept.run['points']['count'], 'again', '', '%.4f' % said['solve_seconds'],
              '%.4f' % said['solve_device_seconds'], '%.1f' % (said['returned_bytes'] / 1e6),
              '%.3f' % said['write_seconds'])


def links(kiln, scene, sizes=((256, 17.7), (1024, 70.8))):
    """Links of two bounces, the first of which finds them: rays that say what points see, and those that close rows."""
    table = harness.Table(('points', 9), ('backend', 8), ('found, s', 9), ('device, s', 9), ('rays', 8), ('Mrays/s', 8),
                          ('added, s', 9), ('device, s', 9), ('links', 6), ('bytes', 6), ('relit, s', 9))
    for size, density in sizes:
        bake = kiln.bake(scene, '--method', 'radiosity', '--patches', 'links', '--bounces', 2, '--texels-per-metre',
                         density, '--samples-direct', 16, '--samples-indirect', 64, '--samples-probe', 0, '--denoise',
                         'none', '--no-export', '--keep-transport', 'links', timeout=3600)
        if bake.process.status != 0:
            sys.exit('%s\nended with %d: %s' % (bake.process.line(), bake.process.status, bake.process.sentence()))
        points, rays, said = bake.run['points']['count'], bake.run['rays']['bounces'], bake.run['links']
        first, then = [b for b in bake.run['bounces'] if b['kind'] != 'direct'][:2]
        folder = os.path.join(kiln.scratch, 'links%d' % size)
        p = kiln.command('relight', bake.directory, scene, '-o', folder, '--quiet', timeout=3600)
        if p.status != 0:
            sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
        with open(os.path.join(folder, 'run.json')) as file:
            relit = [b for b in json.load(file)['bounces'] if b['kind'] != 'direct']
        table.row(points, bake.run['backend']['name'], '%.3f' % first['seconds'], '%.3f' % first['device_seconds'],
                  '%.2g' % rays, '%.1f' % (rays / first['seconds'] / 1e6), '%.3f' % then['seconds'],
                  '%.3f' % then['device_seconds'], '%.0f' % (said['count'] / points), '%.0f' % (said['bytes'] / points),
                  '%.3f' % sum(b['seconds'] for b in relit))
        bake.remove()


def gloss(kiln):
    """Rays a second of the device: of light paths that land, and of bounces and final gather, whose rays go on in
    chains or, where materials are taken as diffuse, do not; and views by paths of pixels, likewise. Each bake comes
    twice, and the second counts: while kernels are made in the first the device falls to its idle clocks. `sorted`: of
    the time of landings by the clock, that of sorting, exchanging and summing."""
    table = harness.Table(('scene', 16), ('light paths', 11), ('rays', 8), ('clock, s', 8), ('sorted', 6),
                          ('device, s', 9), ('Grays/s', 8), ('gather, Grays/s', 15), ('share', 6),
                          ('without gloss', 13))
    scenes = [('cornell-spheres', measure.made(kiln, 'cornell-spheres'), 30)]
    dining = os.path.join(harness.SHARED, 'third_party', 'dining_room.glb')
    if os.path.exists(dining):
        scenes.append(('dining room', dining, 20))
    for name, scene, density in scenes:
        paths, landed, gathers = 4 << 24, None, []
        for materials in ('auto', 'diffuse'):
            more = () if materials == 'diffuse' else ('--caustics', 'land', '--photons', paths // 4, '--iterations', 4)
            for _ in range(2):
                bake = kiln.bake(scene, '--texels-per-metre', density, '--samples-direct', 16, '--samples-bounce', 256,
                                 '--samples-indirect', 1024, '--samples-probe', 0, '--bounces', 2, '--denoise', 'none',
                                 '--no-export', '--materials', materials, *more, timeout=3600)
                if bake.process.status != 0:
                    sys.exit('%s\nended with %d: %s' %
                             (bake.process.line(), bake.process.status, bake.process.sentence()))
            rays = bake.run['rays']
            device = lambda *kinds: sum(b['device_seconds'] for b in bake.run['bounces'] if b['kind'] in kinds)
            gathers.append((rays['bounces'] + rays['final']) / device('bounce', 'final') / 1e9)
            caustic = [b for b in bake.run['bounces'] if b['kind'] == 'caustic']
            landed = landed or (rays['caustics'], device('caustic'),
                                sum(b['seconds'] + b['exchange_seconds'] for b in caustic),
                                sum(b['exchange_seconds'] for b in caustic))
            bake.remove()
        speed = landed[0] / landed[1] / 1e9
        table.row(name, '%.2g' % paths, '%.2g' % landed[0], '%.3f' % landed[2], '%.2f' % (landed[3] / landed[2]),
                  '%.3f' % landed[1], '%.2f' % speed, '%.2f' % gathers[0],
                  '%.2f' % (speed / gathers[0]), '%.2f' % gathers[1])
    table = harness.Table(('view by path', 16), ('materials', 9), ('paths a pixel', 13), ('seconds', 8),
                          ('ms a path', 9))
    for name, scene, _ in scenes:
        for materials in ('auto', 'diffuse'):
            p = kiln.command('view', scene, '--method', 'path', '--backend', 'vulkan', '--width', 1280, '--height', 720,
                             '--samples-pixel', 64, '--materials', materials, '--json', '--quiet', '-o',
                             os.path.join(kiln.scratch, 'view.exr'), timeout=3600)
            if p.status != 0:
                sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
            seconds = p.json()['seconds']
            table.row(name, materials, 64, '%.3f' % seconds, '%.1f' % (1e3 * seconds / 64))


WHAT = ('rates', 'scaling', 'pairs', 'visibility', 'states', 'links', 'gloss')


def main():
    def add(p):
        p.add_argument('--gpus', type=int, nargs='*', default=[1])
        p.add_argument('--only', nargs='+', choices=WHAT, default=WHAT)
    arguments, kiln = harness.start(__doc__, add)
    kiln.backend = 'vulkan'
    if 'pairs' in arguments.only:
        pairs(kiln, measure.made(kiln, 'cornell-statue', '--triangles', 29429))
    if 'visibility' in arguments.only:
        visibility(kiln, measure.made(kiln, 'cornell-statue', '--triangles', 29429))
    if 'links' in arguments.only:
        links(kiln, measure.made(kiln, *SCENES[1][1]))
    if 'gloss' in arguments.only:
        gloss(kiln)
    if 'states' in arguments.only:
        states(kiln, measure.made(kiln, 'cornell'))
    if not {'rates', 'scaling'} & set(arguments.only):
        return
    made = {name: measure.made(kiln, *how) for name, how, _, _ in SCENES}
    if 'rates' in arguments.only:
        rates(kiln, made)
    if 'scaling' in arguments.only:
        scaling(kiln, made['city, 4 million'], arguments.gpus)


if __name__ == '__main__':
    main()
