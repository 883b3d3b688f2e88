"""What the benches share: errors against a converged bake, ladders of sample counts, and the cost at equal error."""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402


def values(bake, names=None):
    """Irradiance of the valid points (n, 3) by object and texel, of the objects called `names` (all)."""
    p = bake.points
    chosen = p.valid.copy()
    if names is not None:
        chosen &= np.isin(p.object, [bake.index(n) for n in names])
    order = np.lexsort((p.x[chosen], p.y[chosen], p.object[chosen]))
    return p.total[chosen][order]


def nrmse(got, reference):
    """Root mean square of the difference over the mean of the reference, all channels."""
    return math.sqrt(float(np.mean((got - reference) ** 2))) / float(reference.mean())


def tracing_seconds(bake):
    """Seconds in passes: what grows with the samples."""
    return sum(p['seconds'] for p in bake.run['bounces'])


def at_error(ladder, target):
    """Cost at an error of `target`, between the rungs of [(error, cost), ...] by powers; beyond them by the nearest
    pair. Errors fall along the ladder."""
    for (e0, c0), (e1, c1) in zip(ladder, ladder[1:]):
        if e1 <= target or (e1, c1) == ladder[-1]:
            slope = math.log(c1 / c0) / math.log(e0 / e1)
            return c0 * (e0 / target) ** slope
    raise ValueError('a ladder needs two rungs')


def must(bake):
    """A bench has no use for a bake that failed."""
    if bake.process.status != 0:
        sys.exit('%s\nended with %d: %s' % (bake.process.line(), bake.process.status, bake.process.sentence()))
    return bake


def made(kiln, name, *options):
    """Path of a scene of `kiln generate`, made once in the scratch folder."""
    path = os.path.join(kiln.scratch, '-'.join([name] + [str(o).lstrip('-') for o in options]) + '.glb')
    if not os.path.exists(path):
        p = kiln.command('generate', name, '-o', path, *options, '--quiet')
        if p.status != 0:
            sys.exit('%s\nended with %d: %s' % (p.line(), p.status, p.sentence()))
    return path
