"""A bake for some views (--only-visible-from) has the light of what they see, and little else.

- In three open rooms and one camera, what is seen has the direct light of the whole bake and all but 0.2 % of its
  indirect light; the rest is not valid and 0. The final gather has rays for the seen points alone. The same bits on 3
  ranks. kiln plan counts the same points, and plans a shorter final gather.
- In a room behind a sealed wall, with a path of a camera in the lit part, little beyond the wall is lit.
- Views that there are not, or that see nothing, and options that judge all light, are refused with a sentence.
"""
import json
import os
import sys

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import harness  # noqa: E402
import same_result  # noqa: E402
import walls  # noqa: E402

FEW = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--samples-direct', 32, '--samples-bounce', 8,
       '--samples-indirect', 32)
ROOMS = os.path.join(harness.REPOSITORY, 'jobs', 'rooms.glb')


def light(bake):
    """(direct light, indirect light, valid, x) by object and texel."""
    p = bake.points
    order = np.lexsort((p.x, p.y, p.side, p.object))
    return p.direct[order], p.indirect[order], p.valid[order] > 0, p.position[order][:, 0]


def check(checks, what, whole, some):
    """What is seen has the light of the whole bake; gives which points these are."""
    (direct, all_, _, x), (seen_direct, few, seen, _) = light(whole), light(some)
    mean = all_[seen].mean()
    off, most = few[seen].mean() / mean - 1, np.sqrt(((all_ - few)[seen]**2).mean()) / mean
    print('%s: %s, sum %+.1e, rms %.1e' % (what, some.run['visible_from'], off, most))
    checks.that(seen.any() and (direct[seen] == seen_direct[seen]).all(), '%s: other direct light' % what, some.process)
    checks.that(abs(off) < 0.002 and most < 0.002, '%s: indirect light is off by %g, rms %g' % (what, off, most),
                some.process)
    checks.that(not few[~seen].any() and not seen_direct[~seen].any(), '%s: what is not seen has light' % what,
                some.process)
    said = some.run['visible_from']
    checks.that(said['seen'] == seen.sum() and said['valid'] == len(seen) - whole.run['points']['invalid'],
                '%s: %s, %d are seen' % (what, said, seen.sum()), some.process)
    share = some.run['rays']['final'] / whole.run['rays']['final']
    checks.that(abs(share - said['seen'] / said['valid']) < 0.01, '%s: the final gather has %g of the rays for %s' %
                (what, share, said), some.process)
    return seen, x


def check_plan(kiln, checks, options, some):
    """kiln plan counts what the bake `some` for the rooms' views counts, and plans a shorter final gather for it."""
    plans = []
    for more in ((), ('--only-visible-from', 'all')):
        process = kiln.command('plan', *options[:3], '--samples-indirect', 32, '--samples-probe', 0, '--backend',
                               'embree', '--threads', 1, '--json', *more)
        checks.that(process.status == 0, 'kiln plan ended with %d' % process.status, process)
        if process.status != 0:
            return
        plans.append(json.loads(process.stdout))
    said = {name: some.run['visible_from'][name] for name in ('views', 'valid', 'seen', 'reached')}
    checks.that(plans[1].get('visible_from') == said and 'visible_from' not in plans[0], 'rooms: the plan says %s, and '
                'the bake %s' % (plans[1].get('visible_from'), said), process)
    whole, few = (p['seconds']['final'] for p in plans)
    checks.that(few < 0.7 * whole, 'rooms: the plan has a final gather of %g s for all, of %g s for %s' %
                (whole, few, said), process)


def check_rooms(kiln, checks):
    options = (ROOMS, '--texels-per-metre', 4, *FEW)
    whole, some = kiln.bake(*options), kiln.bake(*options, '--only-visible-from', 'all')
    if not (checks.baked(whole) and checks.baked(some)):
        return
    seen, _ = check(checks, 'rooms', whole, some)
    checks.that(0.1 < seen.mean() < 0.6, 'rooms: %g of all is seen' % seen.mean(), some.process)
    if kiln.backend == 'vulkan':
        return
    check_plan(kiln, checks, options, some)
    ranks = kiln.bake(*options, '--only-visible-from', 'all', ranks=3)
    if checks.baked(ranks):
        checks.that(same_result.points(ranks) == same_result.points(some), 'rooms: 3 ranks have other bits',
                    ranks.process)


def check_wall(kiln, checks):
    scene, path = (os.path.join(kiln.scratch, name) for name in ('room.glb', 'path.csv'))
    walls.room(scene, 0, 0.01)
    with open(path, 'w', encoding='utf-8') as f:
        f.write('from.x,from.y,from.z,to.x,to.y,to.z,field-of-view\n-1,1,0,-2,1,0.5,60\n-1.2,1,0,-2,1.2,-0.5,60\n')
    options = (scene, '--texels-per-metre', 8, *FEW)
    whole, some = kiln.bake(*options), kiln.bake(*options, '--only-visible-from', path)
    if not (checks.baked(whole) and checks.baked(some)):
        return
    seen, x = check(checks, 'room', whole, some)
    said = some.run['visible_from']
    checks.that(said['views'] == 9 and x[seen].max() < walls.WALL, 'room: %s, and as far as %g m is seen' %
                (said, x[seen].max()), some.process)
    lit = (said['seen'] + said['reached']) / said['valid']
    checks.that(0.4 < lit < 0.75, 'room: %g of all has light' % lit, some.process)
    rays = some.run['rays']['bounces'] / whole.run['rays']['bounces']
    checks.that(rays < 0.8, 'room: bounces have %g of the rays' % rays, some.process)
    outside = path + '.outside.csv'
    with open(outside, 'w', encoding='utf-8') as f:
        f.write('from.x,from.y,from.z,to.x,to.y,to.z\n9,9,9,19,9,9\n9,9,9,19,9,8\n')
    for status, words, views in ((65, 'sees a surface', (outside,)), (64, "no camera 'nobody'", ('nobody',)),
                                 (64, 'has no camera', ('all',)), (64, 'exclude', (path, '--target-error', 0.1)),
                                 (64, 'exclude', (path, '--error-map')), (64, 'exclude', (path, '--check-density'))):
        refused = kiln.bake(*options, '--only-visible-from', *views)
        checks.that(refused.process.status == status and words in refused.process.stderr, '%s: %d, %s' %
                    (views, refused.process.status, refused.process.stderr), refused.process)


def main():
    _, kiln = harness.start(__doc__)
    checks = harness.Checks()
    check_rooms(kiln, checks)
    if kiln.backend == 'embree':
        check_wall(kiln, checks)
    checks.end()


if __name__ == '__main__':
    main()
