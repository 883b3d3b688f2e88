"""Bakes every scene that is listed as good, quick and coarse, and checks all that comes out; has every malformed one
refused.

A good bake ends with 0 and leaves a run.json that parses, a lightmap for each object, kiln.h5 and volume.hdf without
NaN, infinity or negative irradiance, areas that sum to the surface's, and energy that is kept. A malformed scene is
answered within 5 seconds with exit code 65 and a sentence that names the file, and nothing is written. With --thin, for
slow devices, lightmaps are coarser still. --full has finer ones, and the scene that takes longest.
"""
import glob
import json
import os
import sys

import h5py
import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import harness  # noqa: E402

COARSE = ('--quality', 'draft', '--lightmap-max', 64, '--samples-direct', 16, '--samples-bounce', 4,
          '--samples-indirect', 16, '--samples-probe', 16, '--iterations', 2)
# By file name: what else a scene needs to be quick, or to be lit at all.
MORE = {
    'city_instanced.glb': ('--lightmap-max', 8),
    'voxelcity_47k.glb': ('--lightmap-max', 64),
    # with texels 4 m wide, of which columns divide many, light beside a column is taken from too far away
    'crytek_sponza.glb': ('--lightmap-max', 48, '--bounces', 6),
    'dining_room.glb': ('--bounces', 6),  # of some seventy
    'godot_living_room.glb': ('--environment', '1,1,1'),
    'godot_room.glb': ('--environment', '1,1,1'),
    'godot_zdm2.glb': ('--environment', '1,1,1'),
}
# Many points, of which fewer do; not with --full.
COARSER = {
    'ext_mesh_gpu_instancing_required.glb': ('--lightmap-max', 16),
    'many_lights.glb': ('--lightmap-max', 24),
}
# 1601 objects in few texels: some thousand charts want the same texel, and the choice among them is slow. With --full
# only.
SLOW = {'city_instanced.glb'}
# They need a decoder that kiln does not have, or an extension nobody knows, and say so themselves.
REFUSED = {'webp_required.glb', 'unknown_required_extension_must_refuse.glb'}
SCENES = ('*.glb', '*.gltf', '*.obj')
LONGEST_ANSWER = 5.0


# Surfaces that lie twice in the same place receive all light twice, and no ledger can balance that.
TWICE = {'nasty_valid.glb'}


def listed(folder):
    return sorted(f for pattern in SCENES for f in glob.glob(os.path.join(glob.escape(folder), pattern)))


def numbers_are_good(checks, what, values, process, negative=False):
    values = np.asarray(values)
    good = bool(np.isfinite(values).all()) and (negative or bool((values >= 0).all()))
    return checks.that(good, '%s: %d values are not finite, %d are negative' % (
        what, int((~np.isfinite(values)).sum()), int((values < 0).sum())), process)


def check_outputs(checks, name, bake):
    """Returns what the table says about energy."""
    run, process = bake.run, bake.process
    for entry in run['objects']:
        path = os.path.join(bake.directory, entry['lightmap'])
        if not checks.that(os.path.isfile(path), '%s: %s is not there' % (name, entry['lightmap']), process):
            continue
        channels, _ = harness.read_exr(path)
        checks.that({'R', 'G', 'B'} <= set(channels),
                    '%s: %s has channels %s' % (name, entry['lightmap'], sorted(channels)), process)
        for channel, values in channels.items():
            numbers_are_good(checks, '%s: %s channel %s' % (name, entry['lightmap'], channel), values, process)
            checks.that(values.shape == (entry['height'], entry['width']),
                        '%s: %s is %s' % (name, entry['lightmap'], values.shape), process)
    points = bake.points
    checks.that(points.count == run['points']['count'], '%s: kiln.h5 has %d points, run.json %d' % (
        name, points.count, run['points']['count']), process)
    for field in ('direct', 'indirect', 'total', 'error', 'area'):
        numbers_are_good(checks, '%s: kiln.h5 %s' % (name, field), getattr(points, field), process)
    # of fronts: backs have points of their own
    area, whole = points.area[points.side == 0].sum(), run['points']['geometry_area']
    checks.that(abs(area - whole) <= 1e-3 * whole, '%s: texels cover %g m2 of %g m2' % (name, area, whole), process)
    found, wanted = set(os.listdir(bake.directory)), {'run.json', 'kiln.h5', 'volume.hdf', 'lightmaps', 'scene.kscene',
                                                      'scene.glb', 'manifest'}
    if sum(run['energy']['emitted']) == 0 and 'volume.hdf' not in found:  # no light, and so no probes
        wanted.remove('volume.hdf')
    else:
        with h5py.File(os.path.join(bake.directory, 'volume.hdf'), 'r') as f:
            for field, data in f['VTKHDF/PointData'].items():
                numbers_are_good(checks, '%s: volume.hdf %s' % (name, field), data[...], process,
                                 negative=field in ('irradiance_sh', 'occluders', 'offset'))
    checks.that(found == wanted, '%s: the folder holds also %s, and not %s' %
                (name, sorted(found - wanted), sorted(wanted - found)), process)
    if name in TWICE:
        return harness.energy(bake.run)[0]
    return checks.energy(bake, name)


def good(checks, kiln, table, path, options):
    name = os.path.basename(path)
    bake = kiln.bake(path, *COARSE, *options, *kiln.more.get(name, ()), timeout=400)
    if checks.baked(bake):
        text = check_outputs(checks, name, bake)
        invalid = bake.points.count - int(bake.points.valid.sum())
        mean = float((bake.points.total @ harness.LUMINANCE).mean()) if bake.points.count else 0.0
        table.row(name, len(bake.run['objects']), bake.points.count, invalid, '%.3g' % mean,
                  '%.1f' % bake.process.seconds,
                  '%.0f' % (bake.process.peak_bytes / 2**20), text)
    else:
        table.row(name, '-', '-', '-', '-', '%.1f' % bake.process.seconds, '-', 'exit %d' % bake.process.status)
    bake.remove()


def bad(checks, kiln, table, path, what):
    name = os.path.basename(path)
    bake = kiln.bake(path, *COARSE, timeout=30)
    p = bake.process
    table.row(name, p.status, '%.1f' % p.seconds, p.sentence()[:110].replace(os.path.dirname(path) + '/', ''))
    checks.that(p.status == harness.BAD_INPUT, '%s (%s): exit %d instead of 65' % (name, what, p.status), p)
    checks.that(p.seconds < LONGEST_ANSWER, '%s (%s): answered after %.1f s' % (name, what, p.seconds), p)
    checks.that(name in p.stderr, '%s (%s): the answer does not name the file' % (name, what), p)
    written = os.listdir(bake.directory) if os.path.exists(bake.directory) else []
    checks.that(not os.path.exists(bake.directory),
                '%s (%s): left behind %s/%s' % (name, what, bake.directory, written), p)
    bake.remove()


def all_good(checks, kiln, paths, *options):
    table = harness.Table(('scene', 44), ('objects', 8), ('points', 9), ('invalid', 8), ('mean E', 9), ('seconds', 8),
                          ('MiB', 6),
                          ('energy', 40))
    for path in paths:
        good(checks, kiln, table, path, options)


def all_bad(checks, kiln, paths):
    """`paths`: {path: what is wrong with it}."""
    table = harness.Table(('scene', 44), ('exit', 5), ('seconds', 8), ('answer', 110))
    for path, what in paths.items():
        bad(checks, kiln, table, path, what)


def main():
    which = ('own', 'features', 'third_party', 'bad')
    arguments, kiln = harness.start(__doc__, lambda p: p.add_argument('--set', choices=which, required=True),
                                    lambda p: p.add_argument('--only', metavar='FILE', action='append',
                                                             help='these scenes'),
                                    lambda p: p.add_argument('--full', action='store_true',
                                                             help='finer lightmaps, every scene'))
    wanted = lambda path: os.path.basename(path) in arguments.only if arguments.only else (
        arguments.full or os.path.basename(path) not in SLOW)
    checks = harness.Checks()
    coarser = ('--lightmap-max', 32) if kiln.thin > 1 else ('--lightmap-max', 128) if arguments.full else ()
    kiln.more = MORE if arguments.full else {**MORE, **COARSER}
    if arguments.set == 'own':
        found = listed(os.path.join(harness.SHARED, 'own')) or listed(harness.DATA)
        all_good(checks, kiln, filter(wanted, found), *coarser)
    elif arguments.set == 'features':
        found = listed(harness.need_shared('own', 'features'))
        all_good(checks, kiln, [f for f in found if os.path.basename(f) not in REFUSED and wanted(f)], *coarser)
        all_bad(checks, kiln,
                {f: 'what it requires cannot be had' for f in found if os.path.basename(f) in REFUSED and wanted(f)})
    elif arguments.set == 'third_party':
        folder = harness.need_shared('third_party')
        found = listed(folder) + listed(os.path.join(folder, 'noncommercial'))
        all_good(checks, kiln, filter(wanted, found), '--lightmap-max', 32)
    else:
        folder = harness.need_shared('own', 'bad')
        with open(os.path.join(folder, 'index.json')) as f:
            index = json.load(f)
        found = [os.path.join(folder, f) for f in sorted(index)]
        all_bad(checks, kiln, {f: index[os.path.basename(f)]['what'] for f in found if wanted(f)})
    checks.that(bool(found), 'no scene was found')
    checks.end()


if __name__ == '__main__':
    main()
