"""--patches links and --gather mixed on a Vulkan device against Embree: the host goes down the same tree, and chooses
the same patches, so it is the same light but for rounding, and for rays that pass by an edge.

- The Cornell box: the same links but for 1e-4 of them; light of 99 % of the texels within 1e-5, and its stated error
  within 1e-3.
- With --full kept links (--keep-transport links): relit with nothing changed, the bake bit for bit, and no ray; relit
  from what Embree has kept, the light that Embree relights from it.
- Then too the same bits from short dispatches, three ranks, a bake that goes on after it was stopped, and a device that
  was lost; --target-error; smooth normals and glass; a closed furnace within 0.1 %.
"""
import os
import sys

import h5py
import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, '..', 'common'), os.path.join(HERE, '..', 'mpi'), HERE]
import harness  # noqa: E402
import patches  # noqa: E402
import same_result  # noqa: E402
from reading import run_json  # noqa: E402
from patches import CORNELL, FEW  # noqa: E402

BOX = (*FEW, '--texels-per-metre', 1, '--bounces', 2, '--error-map')
LINKS = ('--patches', 'links:0.03')
KEEP = ('--keep-transport', 'links')
MIXED = ('--lights', 'patches', '--gather', 'mixed:64')
SPHERES = 'cornell_spheres.glb'  # smooth normals, and glass
STOPPED = 75


def indirect(folder):
    """Light that came by links and its stated error, of texels in order."""
    with h5py.File(os.path.join(folder, 'kiln.h5'), 'r') as file:
        texel = file['points/texel'][...].reshape(-1, 2)
        order = np.lexsort((texel[:, 0], texel[:, 1], file['points/object'][...]))
        error = file['irradiance/error_indirect'][...] if 'error_indirect' in file['irradiance'] else np.zeros(1)
        light = file['irradiance/indirect'][...].astype(np.float64)
        return light[order], (error[order] if len(error) > 1 else error).astype(np.float64)


def apart(found, wanted, bound):
    """Which share of the texels is off by more, and the largest that one is off by."""
    off = np.abs(found - wanted) / np.maximum(wanted, 1e-3 * wanted.mean())
    off = off.max(axis=1) if off.ndim > 1 else off
    return (off > bound).mean(), off.max()


def check_error(checks, embree, vulkan):
    count = [bake.run['links']['count'] for bake in (embree, vulkan)]
    checks.that(abs(count[1] / count[0] - 1) < 1e-4, '%d and %d links' % tuple(count), vulkan.process)
    errors = [indirect(bake.directory)[1] for bake in (embree, vulkan)]
    share, most = apart(errors[1], errors[0], 1e-3)
    checks.that(errors[0].mean() > 0 and share <= 0.02, 'stated errors: %g of the texels are apart, at most by %g' %
                (share, most), vulkan.process)


def relit(kiln, checks, bake, backend):
    """What comes of relighting with nothing changed: light and error; rays, and the folder."""
    folder = bake.directory + '-relit-' + backend
    process = kiln.command('relight', bake.directory, CORNELL, '--backend', backend, '--no-preview', '--quiet', '-o',
                           folder)
    if not checks.that(process.status == 0, 'relight: %s' % process.sentence(), process):
        return None
    return (*indirect(folder), run_json(folder)['relight'])


def check_relight(kiln, checks, embree, vulkan):
    same = relit(kiln, checks, vulkan, 'vulkan')
    if same is not None:
        light, error = indirect(vulkan.directory)
        checks.that((same[0] == light).all() and (same[1] == error).all() and same[2]['links_traced'] == 0 and
                    same[2]['links_replayed'] > 0, 'relit from its own links: other bits, %s' % same[2])
    one, other = (relit(kiln, checks, embree, backend) for backend in ('embree', 'vulkan'))
    if one is not None and other is not None:
        share, most = apart(other[0], one[0], 1e-5)
        checks.that(share == 0 and other[2]['links_traced'] == 0,
                    "relit from Embree's links: %g of the texels are apart, at most by %g" % (share, most))


def check_stopped(kiln, checks, wanted):
    """A bake that is stopped when it has begun, and goes on."""
    folder = os.path.join(kiln.scratch, 'stopped')
    again = lambda *more: kiln.command('bake', CORNELL, *BOX, *LINKS, *KEEP, '--backend', 'vulkan', '--no-preview',
                                       '--quiet', '-o', folder, *more)
    stops, seconds, process = 0, 0.2, again('--max-time', 0.2)
    while process.status == STOPPED and stops < 20:
        stops += 1
        seconds *= 1.5
        process = again('--max-time', seconds)
    bake = harness.Bake(folder, process)
    if checks.baked(bake):
        checks.that(stops > 0 and same_result.points(bake) == wanted, 'stopped %d times: other bits' % stops, process)


def check_all(kiln, checks, table, wanted):
    patches.check_same_bits(kiln, checks, wanted, (*LINKS, *KEEP), box=BOX)
    check_stopped(kiln, checks, wanted)
    both = patches.compare(kiln, checks, table, 'target', CORNELL, *BOX, *LINKS, '--target-error', 0.01,
                           both=True)
    if both is not None:
        check_error(checks, *both)
    if harness.own_scene(SPHERES) is not None:
        patches.compare(kiln, checks, table, SPHERES, harness.own_scene(SPHERES), *FEW, *LINKS, '--texels-per-metre',
                        1.5, '--bounces', 1)
    patches.check_furnace(kiln, checks, *LINKS)


def main():
    def add(p):
        p.add_argument('--full', action='store_true', help='all of it')
        p.add_argument('--mixed', action='store_true', help='--gather mixed alone')
    arguments, kiln = harness.start(__doc__, add)
    kiln.environment['KILN_VULKAN_VALIDATION'] = os.environ.get('KILN_VULKAN_VALIDATION', '1')
    checks = harness.Checks()
    table = harness.Table(('scene', 44), ('rays', 9), ('more', 5), ('median', 8), ('worst', 8), ('apart', 5),
                          ('all', 9))
    if arguments.mixed:
        patches.compare(kiln, checks, table, 'mixed', CORNELL, *FEW, '--texels-per-metre', 1, '--bounces', 1, *MIXED)
        checks.end()
        return
    both = patches.compare(kiln, checks, table, 'links', CORNELL, *BOX, *LINKS, *KEEP, both=True)
    if both is not None:
        check_error(checks, *both)
        said = both[1].run['backend']
        checks.that(said['name'] == 'vulkan' and 'links' in said['kernels'], 'run.json says %s' % said)
        if arguments.full:
            check_relight(kiln, checks, *both)
            check_all(kiln, checks, table, same_result.points(both[1]))
    checks.end()


if __name__ == '__main__':
    main()
