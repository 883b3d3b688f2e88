"""--visibility-cache: pairs of patches that are known are not traced again, and nothing else changes.

- The same bits with room for all pairs, for some and for hardly any as without, with all ways to choose nodes,
  with glass between patches, over 3 ranks whose points move, and after interruptions.
- With room for all, later bounces trace no pair, and most tile pairs need no bits; memory is as `kiln plan` says at
  most.
- By voxels the light goes to that of rays as they get finer; a cache and ranks change no bit of it.
- What it has no use for is refused.
"""
import json
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi')]
import glb  # noqa: E402
import harness  # noqa: E402
import same_result  # noqa: E402

CORNELL = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
FEW = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--method', 'radiosity', '--samples-indirect', 32,
       '--samples-direct', 16, '--bounces', 3)
ALL, SOME = ('--visibility-cache', 1), ('--visibility-cache', 1e-4)


def with_glass(path):
    """The Cornell box with a tinted pane across it, which lets half through, and a board."""
    scene = glb.Scene()
    scene.load(CORNELL)
    for number, (height, alpha) in enumerate(((0.9, {'alphaMode': 'BLEND'}), (0.5, {}))):
        material = scene.material('pane %d' % number, (0.2, 0.5, 0.8), double_sided=True)
        scene.document['materials'][material].update(alpha)
        scene.document['materials'][material]['pbrMetallicRoughness']['baseColorFactor'][3] = 0.5
        scene.quad('pane %d' % number, [(-0.4, height, 0.4), (0.4, height, 0.4), (0.4, height, -0.4),
                                        (-0.4, height, -0.4)], material)
    return scene.write(path)


def check_same(kiln, checks, table, scene, what, *options):
    """Without, with all and with some; the first two's rays of bounces, and what is said of the cache."""
    bakes = [kiln.bake(scene, *FEW, *options, *more) for more in ((), ALL, SOME)]
    if not all([checks.baked(bake) for bake in bakes]):
        return None
    found = [same_result.points(bake) for bake in bakes]
    said = [bake.run.get('visibility_cache') for bake in bakes]
    rays = [bake.run['rays']['bounces'] for bake in bakes]
    checks.that(found[1] == found[0], '%s: a cache gives other bits' % what)
    checks.that(found[2] == found[0], '%s: a cache of a few pairs gives other bits' % what)
    checks.that(said[0] is None and said[1]['rays_saved'] > 0 and rays[0] - rays[1] == said[1]['rays_saved'],
                '%s: rays %s, said %s' % (what, rays, said))
    checks.that(0 < said[2]['rays_saved'] < said[1]['rays_saved'] and said[2]['bytes'] <= 1e-4 * 2 ** 30,
                '%s: of a few pairs it is said %s' % (what, said[2]))
    table.row(what, rays[0], rays[1], rays[2])
    for bake in bakes:
        bake.remove()
    return rays, said[1]


def check_saved(checks, rays, said):
    """Three bounces of the Cornell box: only the first traces pairs."""
    pairs = said['pairs'] / 3
    checks.that(said['rays_saved'] == 2 * pairs and said['cached'] == 1, 'all pairs were to be known: %s' % said)
    checks.that(0.3 < said['open'] < 0.9 and 0 < said['shut'] < 0.5, 'tile pairs: %s' % said)
    checks.that(said['bytes'] < pairs / 4, 'more than two bits a pair: %s' % said)


def check_plan(kiln, checks, said):
    memory = []
    for more in ((), ALL, ('--visibility-cache', 1e-4)):
        process = kiln.command('plan', CORNELL, '--method', 'radiosity', '--texels-per-metre', 4, '--json', *more)
        checks.that(process.status == 0, 'kiln plan ended with %d' % process.status, process)
        memory.append(json.loads(process.stdout)['memory_per_rank']['transport'])
    checks.that(memory[1] - memory[0] >= said['bytes'], 'kiln plan says %s bytes, it were %s' % (memory, said['bytes']))
    checks.that(memory[0] < memory[2] < memory[1], 'kiln plan says %s bytes' % memory)


def check_ranks(kiln, checks):
    few = (*FEW, '--texels-per-metre', 3)
    alone = kiln.bake(CORNELL, *few)
    moved = kiln.bake(CORNELL, *few, *ALL, '--threads', 1, '--rebalance', 'always', ranks=3)
    if checks.baked(alone) and checks.baked(moved):
        wanted = same_result.points(alone)
        checks.that(same_result.points(moved) == wanted, '3 ranks whose points move: other bits')
        check_interrupted(kiln, checks, (*few, *ALL), wanted)


def check_interrupted(kiln, checks, options, wanted):
    """A rank that is slow reaches its time limit, and the same command goes on; what is known is found again."""
    folder, times, limit = os.path.join(kiln.scratch, 'interrupted'), 0, 0.3
    command = [kiln.path, 'bake', CORNELL, '-o', folder, '--quiet', '--no-preview', '--backend', 'embree',
               *map(str, options), '--threads', '1', '--max-time']
    slow = {**kiln.environment, 'KILN_SLOW_RANK': '0:8'}
    process = harness.run([*command, str(limit)], environment=slow)
    while process.status == 75 and times < 20:
        times += 1
        process = harness.run([*command, str(limit * 1.3 ** times)], environment=slow)
    checks.that(process.status == 0 and times >= 2, 'interrupted %d times, ended with %d' % (times, process.status),
                process)
    if process.status == 0:
        checks.that(same_result.points(harness.Bake(folder, process)) == wanted, 'after interruptions: other bits',
                    process)


def check_voxels(kiln, checks):
    few, off = (*FEW, '--texels-per-metre', 2), []
    rays = kiln.bake(CORNELL, *few)
    for voxels in (16, 32, 96):
        more = ('--visibility', 'voxels:%d' % voxels)
        bake = kiln.bake(CORNELL, *few, *more)
        if not checks.baked(rays) or not checks.baked(bake):
            return
        area = bake.points.area
        wanted, found = (b.points.indirect @ harness.LUMINANCE for b in (rays, bake))
        off.append(np.sqrt((found - wanted) ** 2 @ area / (wanted ** 2 @ area)))
        checks.that(bake.run['rays']['bounces'] < 0.2 * rays.run['rays']['bounces'], 'rays go between patches',
                    bake.process)
        if voxels == 32:
            others = [kiln.bake(CORNELL, *few, *more, *ALL),
                      kiln.bake(CORNELL, *few, *more, '--threads', 1, '--rebalance', 'always', ranks=3)]
            for other in others:
                checks.that(checks.baked(other) and same_result.points(other) == same_result.points(bake),
                            'voxels with a cache or three ranks: other bits', other.process)
    print('voxels, 16, 32, 96: off by %s' % ', '.join('%.2e' % x for x in off))
    checks.that(off[0] > off[1] > off[2] and off[0] < 0.1 and 0 < off[2] < 0.025, 'voxels: off by %s' % off)


def check_refusals(kiln, checks):
    radiosity = ('--method', 'radiosity')
    for more in (('--voxels', 64), ('--visibility', 'voxels', '--patches', 'links'),
                 ('--visibility', 'voxels', '--gather', 'even')):
        process = kiln.bake(CORNELL, *radiosity, *more).process
        checks.that(process.status == 64 and '--v' in process.stderr and ': ' in process.sentence(),
                    '%s was not refused: %d, %s' % (more, process.status, process.stderr))
    for method, more in (('cells', ALL), ('path', ALL), ('cells', ('--visibility', 'voxels'))):
        process = kiln.bake(CORNELL, '--method', method, *more).process
        checks.that(process.status == 64 and more[0] in process.stderr and ': ' in process.sentence(),
                    '%s beside --method %s was not refused: %d, %s' % (more, method, process.status, process.stderr))


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    table = harness.Table(('rays of bounces', 30), ('none', 12), ('all', 12), ('some', 12))
    four, three = ('--texels-per-metre', 4), ('--texels-per-metre', 3)
    found = check_same(kiln, checks, table, CORNELL, 'Cornell box', *four)
    if found is not None:
        check_saved(checks, *found)
        check_plan(kiln, checks, found[1])
    for more in (('--undersample', 'random'), ('--undersample', 'mipmap'), ('--subdivide', 0.1)):
        check_same(kiln, checks, table, CORNELL, ' '.join(map(str, more)), *three, *more)
    check_same(kiln, checks, table, with_glass(os.path.join(kiln.scratch, 'glass.glb')), 'glass', *three)
    check_ranks(kiln, checks)
    check_voxels(kiln, checks)
    check_refusals(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
