"""Devices of one host help each other: a rank that is done computes points of one that is not, which it brings to its
device first. One rank is made slow (KILN_SLOW_RANK): it traces less than its share, all together trace the same
rays, and all bits are those of one rank; after the pilot of direct light, and with --full with kept rays and where
a device is lost as well.
"""
import os
import sys

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [HERE, os.path.join(HERE, '..', 'common')]
import harness  # noqa: E402
from same_bits import bits  # noqa: E402

OPTIONS = ('--texels-per-metre', 4, '--samples-direct', 64, '--samples-bounce', 8, '--samples-indirect', 32,
           '--bounces', 1, '--samples-probe', 0, '--threads', 1, '--cell-size', 1)
WAYS = (  # name, ranks, options, environment
    ('2 ranks', 2, (), {}),
    ('3 ranks, kept rays, lost', 3, ('--keep-transport', 'rows'), {'KILN_GPU_FAULT': 'lost:150'}),
)
SLOW = '1:2'  # no more, for it is as slow while a software device makes its kernels
MOST = 0.9    # of a mean rank's rays, that the slow one of two traces


def rays(bake):
    return {(b['kind'], b['bounce']): b['rays_per_rank'] for b in bake.run['bounces']}


def try_way(checks, kiln, scene, first, way):
    name, ranks, options, environment = way
    kiln.environment.update(environment, KILN_SLOW_RANK=SLOW)
    bake = kiln.bake(scene, *OPTIONS, *options, ranks=ranks)
    for key in (*environment, 'KILN_SLOW_RANK'):
        del kiln.environment[key]
    if not checks.baked(bake):
        return
    wanted, found, alone, traced = bits(first), bits(bake), rays(first), rays(bake)
    other = [k for k in wanted if found.get(k) != wanted[k]]
    checks.that(not other, '%s: other bits in %s' % (name, ', '.join(other)), bake.process)
    given = bake.run['balance']['stolen_points']
    checks.that(given['on'] and given['from_rank'][1] > 0 and sum(given['from_rank']) == sum(given['by_rank']),
                '%s: %s' % (name, given), bake.process)
    for step, share in traced.items():
        checks.that(sum(share) == sum(alone[step]), '%s: %s: %s rays, alone %s' % (name, step, share, alone[step]))
        if ranks == 2:
            checks.that(share[1] < MOST * sum(share) / ranks, '%s: %s: the slow rank has traced %s' %
                        (name, step, share), bake.process)
    lost = bake.run['backend']['recoveries']
    checks.that((lost > 0) == ('KILN_GPU_FAULT' in environment), '%s: %d recoveries' % (name, lost), bake.process)
    print('%-26s %5.1f s, rays %s' % (name, bake.process.seconds, list(traced.values())), flush=True)
    bake.remove()


def main():
    def add(p):
        p.add_argument('--full', action='store_true', help='all of it')
    arguments, kiln = harness.start(__doc__, add)
    kiln.backend = 'vulkan'
    kiln.environment['KILN_DISPATCH_TIME'] = '5'
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    scene = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    first = kiln.bake(scene, *OPTIONS)
    if checks.baked(first):
        for way in WAYS if arguments.full else WAYS[:1]:
            try_way(checks, kiln, scene, first, way)
    checks.end()


if __name__ == '__main__':
    main()
