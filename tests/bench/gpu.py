"""Rays per second of whole bounce passes on a GPU, by traversal and scene, and one bake over several GPUs.

  /usr/bin/python3 tests/bench/gpu.py --kiln build/release/kiln [--gpus 1 2 4]

The aims on one H200 are 8, 2.5 and 2.0 billion rays a second in the Cornell box, at 250 thousand and at 4 million
triangles. The bake is the city's, at least 16 million points; its table shows what of each pass the devices were busy.
"""
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
import measure  # noqa: E402
import harness  # noqa: E402

SCENES = (('Cornell box', ('cornell',), 100, 8.0),
          ('statue, 250 thousand', ('cornell-statue', '--triangles', 250000), 100, 2.5),
          ('city, 4 million', ('city', '--triangles', 4000000), 2.5, 2.0))
TRAVERSALS = ('four', 'binary', 'eight', 'pipeline')


def rates(kiln, made):
    table = harness.Table(('scene', 22), ('traversal', 10), ('Grays/s', 8), ('tracer alone', 12), ('aim', 5))
    for name, _, density, aim in SCENES:
        for traversal in TRAVERSALS:
            p = kiln.command('bench', 'rays', made[name], '--json', '--quiet', '--backend', 'vulkan', '--traversal',
                             traversal, '--texels-per-metre',
                             density, '--samples-indirect', 256, '--repeats', 3, timeout=1800)
            if p.status != 0:
                table.row(name, traversal, '-', p.sentence()[:60], '')
                continue
            r = p.json()
            table.row(name, traversal, '%.2f' % (r['pass_mrays_per_second'] / 1e3),
                      '%.2f' % (r['tracer_mrays_per_second'] / 1e3), '%.1f' % aim)


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


def main():
    add = lambda p: p.add_argument('--gpus', type=int, nargs='*', default=[1])
    arguments, kiln = harness.start(__doc__, add)
    kiln.backend = 'vulkan'
    made = {name: measure.made(kiln, *how) for name, how, _, _ in SCENES}
    rates(kiln, made)
    scaling(kiln, made['city, 4 million'], arguments.gpus)


if __name__ == '__main__':
    main()
