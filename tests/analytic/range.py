"""Gather rays that end at a range, and radiance probes that answer for what is farther (--tracing-range).

A furnace is one at every range, with every basis, scale and store. No light crosses a wall without thickness into a
sealed room. In a Cornell box the error against the unbiased bake falls as the range grows, and is 0 where nothing is as
far. A probe inside a crate darkens its surroundings where probes stay in geometry and nobody asks who sees them, as in
Vandersanden 2023 (figure 4.3.5), and does not where they move. In gaps narrower than the probes' distance little light
is added. The light hangs on neither ranks nor cells, nor on interruptions. Stated errors are true.
"""
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402
import errors  # noqa: E402

BASES = ('sh', 'octahedral', 'cubemap')
DARK = ('--samples-probe', 0, '--no-export', '--denoise', 'none', '--no-stitch')


PLAIN = ('--samples-probe', 0, '--denoise', 'none')
FURNACE = ('--samples-bounce', 16, '--bounces', 'all', '--radiance-probe-spacing', 0.5)
# With what else indirect light may be gathered and kept; scales are of lightmaps alone.
WITH_OTHERS = ((0.7, 'sh', '--indirect-scale', 4), (0, 'octahedral', '--indirect-scale', 4),
               (0, 'sh', '--store', 'octree'), (0.7, 'cubemap', '--store', 'octree'),
               (0.7, 'octahedral', '--store', 'vertex'), (0, 'cubemap', '--store', 'vertex'))


def means(bake, of=None):
    """Mean irradiance, area-weighted, of the points that `of` names."""
    points = bake.points
    keep = points.valid if of is None else points.valid & of
    return float(((points.total @ harness.LUMINANCE) * points.area)[keep].sum() / points.area[keep].sum())


def judge_furnace(checks, table, bake, expected, what):
    found = means(bake) / expected - 1
    checks.that(abs(found) < 0.01, 'furnace, %s: %+.2f %%' % (what, 100 * found), bake.process)
    table.row('furnace, ' + what, '%+.3f %%' % (100 * found))
    bake.remove()


def check_furnace(kiln, checks, table):
    scene = glb.Scene()
    glb.box(scene, 'room', (-1, -1, -1), (1, 1, 1), scene.material('glows', (0.5,) * 3, (2.0,) * 3), range(6))
    path, expected = scene.write(os.path.join(kiln.scratch, 'furnace.glb')), math.pi * 2.0 / 0.5
    every = [(basis, reach) for basis in (BASES if kiln.backend == 'embree' else ('sh', 'cubemap'))
             for reach in ((0, 0.7, 'inf') if basis == 'sh' else (0, 0.7))]
    for basis, reach in (('sh', 0.7), ('cubemap', 0)) if kiln.few else every:
        bake = kiln.bake(path, '--texels-per-metre', 4, *FURNACE, '--samples-direct', kiln.samples(256),
                         '--samples-indirect', kiln.samples(64), '--tracing-range', reach, '--probe-basis', basis,
                         *DARK)
        if checks.baked(bake):
            judge_furnace(checks, table, bake, expected, 'range %s, %s' % (reach, basis))
    for reach, basis, *more in WITH_OTHERS if kiln.backend == 'embree' else WITH_OTHERS[1:3]:
        density = ('--leaf-size', 0.25) if '--store' in more else ('--texels-per-metre', 4)
        bake = kiln.bake(path, *density, *FURNACE, '--samples-direct', kiln.samples(256), '--samples-indirect',
                         kiln.samples(64), '--tracing-range', reach, '--probe-basis', basis, *more, *PLAIN)
        if checks.baked(bake):
            judge_furnace(checks, table, bake, expected, ' '.join(map(str, ('range', reach, basis, *more))))


def split(path, at):
    """A closed room of 4 x 2 x 2 m that a sheet without thickness divides at x = `at`: a lamp on one side."""
    scene = glb.Scene()
    grey = scene.material('grey', (0.6, 0.6, 0.6), double_sided=True)
    glb.box(scene, 'box', (-2, -1, -1), (2, 1, 1), grey, range(6))
    scene.quad('wall', [(at, -1, 1), (at, -1, -1), (at, 1, -1), (at, 1, 1)], grey)
    scene.light('lamp', {'type': 'point', 'intensity': 100.0}, translation=[-1.2, 0.3, 0.2])
    return scene.write(path)


def check_sealed(kiln, checks, table):
    """Also with the sheet right through probes, at a part of the resolution, and in octrees."""
    for at, reach, basis, spacing, *more in (
            (0.05, 0, 'sh', 0.5), (0.05, 0.4, 'octahedral', 0.5), (0.25, 0, 'cubemap', 0.5), (0.25, 0.3, 'sh', 0.5),
            (0.05, 0.2, 'sh', 1.9), (0.05, 0.3, 'octahedral', 0.5, '--indirect-scale', 4),
            (0.05, 0, 'sh', 0.5, '--store', 'octree'), (0.25, 0.3, 'cubemap', 0.5, '--store', 'vertex')):
        density = ('--leaf-size', 0.25) if '--store' in more else ('--texels-per-metre', 4)
        bake = kiln.bake(split(os.path.join(kiln.scratch, 'split.glb'), at), *density, '--samples-direct', 16,
                         '--samples-bounce', 16, '--samples-indirect', kiln.samples(64), '--bounces', 3,
                         '--tracing-range', reach, '--probe-basis', basis, '--radiance-probe-spacing', spacing, *more,
                         *(PLAIN if '--store' in more else DARK))
        if not checks.baked(bake):
            continue
        points = bake.points
        x = points.position[:, 0]
        luminance = points.total @ harness.LUMINANCE
        dark, lit = luminance[points.valid & (x > at + 0.26)], luminance[points.valid & (x < at - 0.26)]
        leak = float(dark.max() / lit.mean())
        what = 'sealed %g, range %g, %s' % (at, reach, ' '.join((basis, *map(str, more))))
        checks.that(leak <= 1e-4, '%s, a probe every %g m: %.1e of the lit side' % (what, spacing, leak), bake.process)
        table.row(what, 'dark / lit %.1e' % leak)
        bake.remove()


def check_falls(kiln, checks, table):
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    options = ('--texels-per-metre', 3, '--samples-direct', 32, '--samples-bounce', kiln.samples(64),
               '--samples-indirect', kiln.samples(256), '--bounces', 3, *DARK)
    true = kiln.bake(cornell, *options)
    if not checks.baked(true):
        return
    area, light = true.points.area[:, None], true.points.total
    for basis in ('octahedral', 'sh') if kiln.backend == 'embree' else ('octahedral',):
        errors = []
        for reach in (0, 2, 4, 20):
            bake = kiln.bake(cornell, *options, '--tracing-range', reach, '--probe-basis', basis,
                             '--radiance-probe-spacing', 0.6)
            if not checks.baked(bake):
                return
            off = bake.points.total - light
            errors.append(math.sqrt(float((area * off ** 2).sum() / (area * light ** 2).sum())))
            bake.remove()
        table.row('Cornell box, ' + basis, 'rms error at 0, 2, 4, 20 m: ' + ' '.join('%.4f' % e for e in errors))
        checks.that(errors[0] < 0.1 and errors[1] < 0.8 * errors[0] and errors[2] < 0.6 * errors[1] and
                    errors[3] == 0.0, 'the error falls with the range, %s: %s' % (basis, errors), true.process)
    true.remove()


def check_shelves(kiln, checks, table):
    """A room with shelves on two walls, whose floor a spot light meets: with the default basis the error of indirect
    light falls as the range grows. With harmonics it does not: whatever part of the hemisphere a probe answers for, it
    has the blur of the rest in it, which the cosine evens out only over the whole."""
    scene = glb.Scene()
    white, red = scene.material('white', (0.7, 0.7, 0.7)), scene.material('red', (0.7, 0.2, 0.2))
    glb.box(scene, 'room', (0, 0, 0), (4, 2.5, 3), white, range(6))
    for near, far in ((0.02, 0.4), (3.6, 3.98)):
        for y in (0.4, 0.8, 1.2, 1.6):
            glb.box(scene, 'shelf %g %g' % (near, y), (near, y, 0.3), (far, y + 0.03, 2.7), red)
    half = math.sqrt(0.5)
    scene.light('spot', {'type': 'spot', 'intensity': 300, 'spot': {'innerConeAngle': 0.4, 'outerConeAngle': 0.6}},
                translation=[2, 2.4, 1.5], rotation=[-half, 0, 0, half])
    path = scene.write(os.path.join(kiln.scratch, 'shelves.glb'))
    options = ('--texels-per-metre', 3, '--samples-direct', 16, '--samples-bounce', 32, '--samples-indirect', 128,
               '--bounces', 2, *DARK)
    backend, kiln.backend = kiln.backend, 'embree'
    true = kiln.bake(path, *options)
    kiln.backend = backend
    if not checks.baked(true):
        return
    area, light, errors = true.points.area[:, None], true.points.indirect, []
    for reach in (0, 1.5) if kiln.few else (0, 0.5, 1.5, 2.5):
        bake = kiln.bake(path, *options, '--tracing-range', reach)
        if not checks.baked(bake):
            return
        errors.append(math.sqrt(float((area * (bake.points.indirect - light) ** 2).sum() / (area * light ** 2).sum())))
        bake.remove()
    table.row('shelves', 'rms error by range: ' + ' '.join('%.4f' % e for e in errors))
    falls = errors[0] < 0.15 and all(b < 0.9 * a for a, b in zip(errors, errors[1:]))
    checks.that(falls, 'the error falls with the range between shelves: %s' % errors, true.process)
    true.remove()


def crates(path):
    """A white room with two closed crates, in each of which a grid of 0.5 m has two probes."""
    scene = glb.Scene()
    white = scene.material('white', (0.7, 0.7, 0.7))
    glb.box(scene, 'room', (-2, -1.5, -2), (2, 1.5, 2), white, range(6))
    for i, (x, z) in enumerate(((-0.25, -0.75), (0.75, 0.25))):
        glb.box(scene, 'crate %d' % i, (x - 0.2, -1.45, z - 0.2), (x + 0.2, -0.55, z + 0.2), white)
    scene.light('lamp', {'type': 'point', 'intensity': 200.0}, translation=[0, 1.2, 0.1])
    return scene.write(path)


def check_leak(kiln, checks, table):
    scene = crates(os.path.join(kiln.scratch, 'crates.glb'))
    options = ('--texels-per-metre', 5, '--samples-direct', 32, '--samples-bounce', 32, '--samples-indirect',
               kiln.samples(128), '--bounces', 3, *DARK)
    found = {}
    for name, more in (('true', ()), ('plain', ('--tracing-range', 0.05, '--radiance-probe-spacing', 0.5)),
                       ('ours', ('--tracing-range', 0.05, '--radiance-probe-spacing', 0.5))):
        if name == 'plain':
            kiln.environment['KILN_PROBES'] = 'plain'
        bake = kiln.bake(scene, *options, *more)
        kiln.environment.pop('KILN_PROBES', None)
        if not checks.baked(bake):
            return
        found[name] = (bake.points.indirect @ harness.LUMINANCE)
        points, report, room = bake.points, bake.run.get('radiance_probes'), bake.index('room')
        if name == 'ours':
            checks.that(report['moved'] + report['off'] >= 4, 'probes in crates: %s' % report, bake.process)
        process = bake.process
        bake.remove()
    crate = points.valid & (points.object != room)
    share = {name: float((found[name] * points.area)[crate].sum() / (found['true'] * points.area)[crate].sum())
             for name in found}
    table.row('crates', 'indirect light against the true one: plain %.2f, ours %.2f' % (share['plain'], share['ours']))
    checks.that(share['plain'] < 0.85, 'probes inside geometry darken the crates: %.3f' % share['plain'], process)
    checks.that(abs(share['ours'] - 1) < 0.06, 'and do not once they are moved: %.3f' % share['ours'], process)


def gap(path, width):
    """The white room with two closed crates, `width` apart and half of it above the floor, with probes about them."""
    scene = glb.Scene()
    white = scene.material('white', (0.7, 0.7, 0.7))
    glb.box(scene, 'room', (-2, -1.5, -2), (2, 1.5, 2), white, range(6))
    for i, x in enumerate((-0.4 - width / 2, width / 2)):
        glb.box(scene, 'crate %d' % i, (x, -1.5 + width / 2, -0.45), (x + 0.4, -0.55, -0.05), white)
    scene.light('lamp', {'type': 'point', 'intensity': 200.0}, translation=[0, 1.2, 0.1])
    return scene.write(path)


def check_gap(kiln, checks, table):
    """Points between and under the crates see probes that are farther than what is around them, and do not ask these:
    light there is that of rays without an end, within the noise and what a probe within the gap is off by."""
    width, found = 0.1, []
    scene = gap(os.path.join(kiln.scratch, 'gap.glb'), width)
    for more in ((), ('--tracing-range', 0.05, '--radiance-probe-spacing', 0.5)):
        bake = kiln.bake(scene, '--texels-per-metre', 6, '--samples-direct', 32, '--samples-bounce', kiln.samples(32),
                         '--samples-indirect', kiln.samples(128), '--bounces', 3, *more, *DARK)
        if not checks.baked(bake):
            return
        points, process = bake.points, bake.process
        x, y, z = points.position.T
        within = points.valid & (z > -0.45) & (z < -0.05) & (y < -0.55)
        light = (points.indirect @ harness.LUMINANCE) * points.area
        under = within & (y < -1.5 + 0.501 * width) & (abs(x) < 0.4 + width / 2)
        found.append([float(light[part].sum()) for part in (within & (abs(x) < 0.501 * width) & ~under, under)])
        bake.remove()
    between, under = found[1][0] / found[0][0], found[1][1] / found[0][1]
    table.row('gap', 'against the true light: between %.2f, under %.2f' % (between, under))
    checks.that(0.9 < between < 1.4 and 0.9 < under < 1.3, 'light in gaps: between the crates %.3f, under them %.3f' %
                (between, under), process)


def check_same(kiln, checks, table):
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    options = ('--texels-per-metre', 4, '--samples-direct', 16, '--samples-bounce', 16, '--samples-indirect', 64,
               '--bounces', 3, '--tracing-range', 1, '--radiance-probe-spacing', 0.7, *DARK)
    first = kiln.bake(cornell, *options)
    if not checks.baked(first):
        return
    expected = harness.lightmap_hashes(first)
    ways = [(3, ('--cell-size', 0.4)), (4, ()), (2, ('--rebalance', 'always', '--threads', 2))]
    for ranks, more in ways if kiln.backend == 'embree' else ways[:1]:
        bake = kiln.bake(cornell, *options, *more, ranks=ranks)
        if checks.baked(bake):
            checks.that(harness.lightmap_hashes(bake) == expected, 'the same bits with %d ranks, %s' % (ranks, more),
                        bake.process)
            checks.that(bake.run['radiance_probes'] == first.run['radiance_probes'], 'the same probes: %s and %s' %
                        (bake.run['radiance_probes'], first.run['radiance_probes']), bake.process)
    table.row('same bits', '%d ways' % len(ways))


def check_errors(kiln, checks, table):
    """In a bake of parts each part has probes of its own rays, so that their noise, which points share, is in what the
    parts differ by: stated errors are true, and the bits those of any ranks; with a target, too. What a range's bias is
    they do not say."""
    reach = ('--tracing-range', 1, '--radiance-probe-spacing', 0.9, '--samples-radiance-probe', 16)
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    values, stated, *_ = errors.bake_all(kiln, cornell, errors.SEEDS, '--error-map', *errors.FEW, *reach)
    lit = (values > 0).all(0)
    off = np.abs(values - values.mean(0)) * math.sqrt(errors.SEEDS / (errors.SEEDS - 1))
    within = 100 * (off[:, lit] < 2 * stated[:, lit]).mean()
    table.row('stated errors', '%.1f %% of texels within two' % within)
    checks.that(92 <= within <= 98.5, '%.1f %% of texels within 2 stated errors' % within)
    for more in (('--error-map', *errors.FEW), ('--error-map', *errors.TARGET)):
        one, three = (kiln.bake(cornell, *errors.OPTIONS, *more, *reach, ranks=ranks) for ranks in (0, 3))
        if checks.baked(one) and checks.baked(three):
            checks.that(harness.lightmap_hashes(one) == harness.lightmap_hashes(three), 'three ranks give other bits: '
                        '%s' % ' '.join(map(str, more)), three.process)


def check_interrupted(kiln, checks, table):
    """A bake that is stopped again and again, within steps too, has the bits of one that is not."""
    cornell = os.path.join(harness.REPOSITORY, 'jobs', 'cornell.glb')
    options = ('--texels-per-metre', 5, '--samples-direct', 16, '--samples-bounce', 64, '--samples-indirect', 2048,
               '--bounces', 3, '--tracing-range', 1, '--radiance-probe-spacing', 0.7, '--threads', 1, *DARK)
    first = kiln.bake(cornell, *options)
    if not checks.baked(first):
        return
    if kiln.backend == 'vulkan':
        options += ('--kernel-cache', kiln.kernels)
        first = kiln.bake(cornell, *options)  # with kernels that are there: how long it takes
    folder, stops, process = os.path.join(kiln.scratch, 'again'), 0, None
    for tries in range(40):
        share = 0.3 + 0.05 * tries
        process = kiln.command('bake', cornell, '-o', folder, '--quiet', '--no-preview', '--backend', kiln.backend,
                               *options, '--max-time', share * first.run['seconds'])
        if process.status == 0:
            break
        stops += 1
    checks.that(process.status == 0 and stops > 1, 'stopped %d times, then %d' % (stops, process.status), process)
    again = harness.Bake(folder, process)
    if process.status == 0:
        checks.that(harness.lightmap_hashes(again) == harness.lightmap_hashes(first), 'the same bits after %d stops' %
                    stops, process)
        checks.that(again.run['radiance_probes']['probes'] == first.run['radiance_probes']['probes'], 'probes', process)
    table.row('interrupted', 'stopped %d times' % stops)


def main():
    every = {'furnace': check_furnace, 'sealed': check_sealed, 'falls': check_falls, 'shelves': check_shelves,
             'leak': check_leak, 'gap': check_gap,
             'same': check_same, 'errors': check_errors, 'interrupted': check_interrupted}
    arguments, kiln = harness.start(
        __doc__, lambda p: p.add_argument('--only', action='append', choices=every, help='these cases'),
        lambda p: p.add_argument('--few', action='store_true', help='furnaces: a range with each basis'))
    kiln.few = arguments.few
    checks = harness.Checks()
    table = harness.Table(('case', 46), ('found', 60))
    for name in arguments.only or every:
        every[name](kiln, checks, table)
    checks.end()


if __name__ == '__main__':
    main()
