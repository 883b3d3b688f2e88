"""The same bits from any number of ranks and threads and from either partition; the same lightmaps from any cell size.

Lightmaps are compared byte by byte, whole files; volume.hdf dataset by dataset; kiln.h5 after sorting its points by
object and texel, since its order follows the cells; once there are so many points that ranks share chunks of it. Scenes
that leave ranks or cells with nothing to do are among them.

Ranks, threads and partition are chosen so that for the first scene every two values of different options meet in a bake
(pairwise cover), and for each further scene every value of every option occurs. --full bakes every combination on every
scene.
"""
import hashlib
import itertools
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

RANKS = (1, 2, 3, 5, 8)
OPTIONS = ('--samples-direct', 64, '--samples-bounce', 4, '--samples-indirect', 16, '--samples-probe', 32)


def datasets(path):
    """{name: (shape, type, hash of the decoded values)} of an HDF5 file."""
    found = {}

    def visit(name, item):
        if isinstance(item, h5py.Dataset):
            values = np.ascontiguousarray(item[...])
            found[name] = (values.shape, str(values.dtype), hashlib.sha256(values.tobytes()).hexdigest())
    with h5py.File(path, 'r') as f:
        f.visititems(visit)
    return found


def lightmaps(bake):
    result = {}
    for entry in bake.run['objects']:
        for key in ('lightmap', 'lightmap_back'):
            if key in entry:
                with open(os.path.join(bake.directory, entry[key]), 'rb') as f:
                    result[entry['name'] + ' ' + key] = hashlib.sha256(f.read()).hexdigest()
    return result


def pixels(bake):
    """Decoded channels, for when whole files differ only in what they say about the run."""
    result = {}
    for entry in bake.run['objects']:
        channels, _ = harness.read_exr(os.path.join(bake.directory, entry['lightmap']))
        result[entry['name']] = {c: hashlib.sha256(np.ascontiguousarray(v).tobytes()).hexdigest() for c,
                                 v in channels.items()}
    return result


def points(bake):
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    return [hashlib.sha256(np.ascontiguousarray(a[order]).tobytes()).hexdigest() for a in (
        p.object, p.side, p.x, p.y, p.area, p.valid, p.direct, p.indirect, p.total, p.error,
        *(p.quantities[name] for name in sorted(p.quantities)))]


class Result:
    def __init__(self, bake, volume=True):
        self.files, self.pixels, self.points = lightmaps(bake), pixels(bake), points(bake)
        path = os.path.join(bake.directory, 'volume.hdf')
        self.volume = datasets(path) if volume and os.path.exists(path) else None


def pairwise(*options):
    """Combinations in which every value of an option meets every value of every other; the first has the first
    values."""
    pairs = lambda row: set(itertools.combinations(enumerate(row), 2))
    rows = list(itertools.product(*options))
    missing, chosen = set().union(*map(pairs, rows)), []
    while missing:
        chosen.append(max(rows, key=lambda row: len(pairs(row) & missing)))  # the first of the best
        missing -= pairs(chosen[-1])
    return chosen


def each(*options):
    """As many combinations as it takes for every value of every option to occur in one; the first has the first
    values."""
    return [tuple(values[i % len(values)] for values in options) for i in range(max(map(len, options)))]


def differences(a, b):
    """What of two results is not the same, as a list of sentences."""
    found = []
    if a.pixels != b.pixels:
        found.append('pixels of ' + ', '.join(sorted(n for n in a.pixels if a.pixels[n] != b.pixels.get(n)))[:200])
    elif a.files != b.files:
        found.append('lightmap files differ though their pixels are the same')
    if a.points != b.points:
        found.append('kiln.h5')
    if a.volume is not None and b.volume is not None and a.volume != b.volume:
        found.append('volume.hdf: ' + ', '.join(sorted(n for n in a.volume if a.volume[n] != b.volume.get(n)))[:200])
    return found


def try_all(checks, kiln, table, name, scene, options, ways, look=None):
    """Bakes with each (ranks, threads, partition) and compares with the first, at which `look` looks, if given."""
    first = None
    for n, threads, partition in ways:
        what = '%d ranks, %d threads, by %s' % (n, threads, partition)
        bake = kiln.bake(scene, *OPTIONS, *options, '--threads', threads, '--partition', partition, ranks=n,
                         timeout=120)
        if checks.baked(bake):
            text = checks.energy(bake, '%s, %s' % (name, what))
            result = Result(bake)
            if first is None and look is not None:
                look(bake)
            first = first or result
            compare(checks, table, name, what, first, result, bake, text)
        bake.remove()
    return first


def compare(checks, table, name, what, first, result, bake, text=''):
    found = differences(first, result)
    checks.that(not found, '%s, %s: not the same as before: %s' % (name, what, '; '.join(found)), bake.process)
    table.row(name, what, '%.1f' % bake.process.seconds, 'same' if not found else 'DIFFERENT', text)


def try_cell_sizes(checks, kiln, table, name, scene, options, sizes, first):
    """Each size against `first`, a result with other cells."""
    for size in sizes:
        bake = kiln.bake(scene, *OPTIONS, *options, '--cell-size', size, ranks=2, timeout=120)
        if checks.baked(bake):
            what = 'cells of %g m: %d' % (size, bake.run['balance']['cells_occupied'])
            compare(checks, table, name, what, first, Result(bake, volume=False), bake)
        bake.remove()


def plain(path, lights, objects=3, points=True):
    """Small quads one above the other; with or without a lamp."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.5, 0.4, 0.3))
    for i in range(objects):
        scene.quad('q%d' % i, [(0, i, 1), (1, i, 1), (1, i, 0), (0, i, 0)], grey)
    if lights:
        scene.light('lamp', {'type': 'point', 'intensity': 5.0, 'color': [1, 1, 1]},
                    translation=[0.5, objects + 0.5, 0.5])
    return scene.write(path)


def try_odd_scenes(checks, kiln, table, some):
    here = lambda n: os.path.join(kiln.scratch, n)

    def is_dark(bake):
        checks.that(not bake.points.total.any(), 'no lights: some irradiance is not 0', bake.process)

    def is_lit(bake):
        largest = bake.points.total.max(initial=0)
        checks.that(bake.points.count == 3 and largest > 0,
                    'one texel an object: %d points of 3, largest irradiance %g' % (
            bake.points.count, largest), bake.process)
    try_all(checks, kiln, table, 'no lights', plain(here('dark.glb'), False), ['--lightmap-size', 16],
            some((3, 1), (1,), ('cells',)), is_dark)
    lit = plain(here('lit.glb'), True)
    try_all(checks, kiln, table, 'one texel an object', lit, ['--lightmap-size', 1],
            some((2, 1, 5), (1, 2), ('cells', 'objects')), is_lit)
    try_all(checks, kiln, table, 'more ranks than cells', lit, ['--lightmap-size', 16, '--cell-size', 100],
            some((1, 3, 8), (1,), ('objects', 'cells')))
    empty = glb.Scene().write(here('empty.glb'))
    for n in (1, 3):
        bake = kiln.bake(empty, *OPTIONS, ranks=n, timeout=60)
        if checks.baked(bake):
            checks.that(bake.run['objects'] == [], 'an empty scene has objects: %s' % bake.run['objects'], bake.process)
            table.row('empty scene', '%d ranks' % n, '%.1f' % bake.process.seconds, 'baked', '')


def main():
    arguments, kiln = harness.start(__doc__,
                                    lambda p: p.add_argument('--full', action='store_true', help='every combination'))
    cornell, zoo = harness.own_scene('cornell_original.glb'), harness.own_scene('punctual_zoo.glb')
    if cornell is None or zoo is None:
        harness.skip('neither tests/data nor ../shared/scenes/own is here.')
    every = lambda *options: list(itertools.product(*options))
    pairs, some = (every, every) if arguments.full else (pairwise, each)
    both, small = ('cells', 'objects'), ['--lightmap-size', 32 if arguments.full else 24]
    checks = harness.Checks()
    table = harness.Table(('scene', 26), ('how', 32), ('seconds', 8), ('result', 10), ('energy', 36))
    first = try_all(checks, kiln, table, 'cornell_original', cornell, [*small, '--cell-size', 1],
                    pairs(RANKS, (1, 2), both))
    by_direction = ['--lightmap-size', 24, '--directional', 'dominant']
    lights = try_all(checks, kiln, table, 'punctual_zoo, dominant', zoo, by_direction, some((1, 3, 8), (1, 2), both))
    # only how many points there are matters: few samples, which are not denoised
    try_all(checks, kiln, table, 'several chunks of points', cornell,
            ['--lightmap-size', 128, '--cell-size', 1, '--samples-direct', 4, '--samples-indirect', 4,
             '--samples-probe', 0, '--denoise', 'none'], some((1, 3, 5), (2,), both))
    two_sides = glb.partition_room(os.path.join(kiln.scratch, 'two_sides.glb'), False)
    sides = try_all(checks, kiln, table, 'double-sided', two_sides, ['--lightmap-size', 24, '--cell-size', 0.7],
                    some((1, 3, 8), (1, 2), both))
    try_all(checks, kiln, table, 'both sides, open share, sh', two_sides,
            ['--lightmap-size', 24, '--sides', 'two', '--ambient-occlusion', 1, '--directional', 'sh1'],
            some((1, 3, 4), (2, 1), both))
    for name, scene, options, cells, before in (
            ('cornell_original', cornell, small, (0.3, 100, 2.7)[:3 if arguments.full else 2], first),
            ('punctual_zoo, dominant', zoo, by_direction, (0.5, 50)[:2 if arguments.full else 1], lights),
            ('double-sided', two_sides, ['--lightmap-size', 24], (0.4, 50)[:2 if arguments.full else 1], sides)):
        if before is not None:
            try_cell_sizes(checks, kiln, table, name, scene, options, cells, before)
    try_odd_scenes(checks, kiln, table, some)
    other = kiln.bake(cornell, *OPTIONS, *small, '--seed', 1)
    if checks.baked(other) and first is not None:
        checks.that(len(differences(first, Result(other))) == 3,
                    'another seed gives the same result: the comparison sees nothing',
                    other.process)
    checks.end()


if __name__ == '__main__':
    main()
