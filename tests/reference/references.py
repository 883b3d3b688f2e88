"""Bakes the scenes that have Monte-Carlo references and compares irradiance at their points.

A point passes when it lies within 5 combined standard errors (reference and bake) or 2 % of the reference; 95 % must
pass, and the ratio of the means must be 1 within 0.005. Points on texels that kiln finds buried in other geometry, and
that are exactly 0 in the reference, are left out: kiln fills those from their neighbours. With --thin (fewer samples) 4
standard errors of the mean are added to the 0.005. Where the reference gives the error of its red channel, each
channel's is taken as the same share of its value.
"""
import json
import math
import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), '..', 'common'))
import glb  # noqa: E402
import harness  # noqa: E402

# Reference points lie at the centres of an n x n grid over the layout: a lightmap side that is an odd multiple of n
# puts them on texel centres. n, the multiple, samples (direct, bounce, indirect), and the multiple with --thin: as
# coarse as the scene's shadows and facets bear; None: they bear nothing coarser, and the scene is left out.
SETTINGS = {
    'cornell_original': (6, 15, 256, 16, 512, 7),
    'cornell_layers': (6, 15, 256, 16, 512, 7),
    'cornell_shapes_narrow': (4, 51, 256, 16, 384, None),  # texels smaller than the facets they compare
    'two_rooms': (6, 15, 512, 32, 512, 7),
    'punctual_zoo': (6, 11, 256, 32, 512, 11),
    'many_lights': (8, 5, 256, 16, 256, 5),
}


# By scene: the multiple and the samples without --full, where a bake would take longer than all the others together.
# They bring the noise of a point from 0.5 % to 2 %, which its standard error says too; what is compared stays.
LESS = {'cornell_shapes_narrow': (25, 64, 16, 96)}

# The references are about facets' own normals, kiln's lightmaps about the shading normal: of scenes with smooth objects
# a copy without normals is baked, which glTF defines as flat.
SMOOTH = {'cornell_shapes_narrow'}


def compare(reference, bake):
    """Arrays, a row a sample: irradiance got and wanted (n, 3), standard errors of both (n, 3)."""
    got, want, errors, where = [], [], [], []
    for sample in reference['samples']:
        name = sample['node']
        lightmap, (u, v) = bake.lightmap(name), sample['uv1']
        e = lightmap.at(u, v)
        own = bake.points.of(bake.index(name))
        texel = bake.points.valid[
            (bake.points.object == bake.index(name)) & (bake.points.x == int(u * lightmap.width)) &
                                  (bake.points.y == int(v * lightmap.height))]
        if not texel.any() and max(sample['E']) == 0:
            continue
        near = (np.abs(bake.points.x[own] + 0.5 - u * lightmap.width) <= 1.6) & (
            np.abs(bake.points.y[own] + 0.5 - v * lightmap.height) <= 1.6)
        own_error = math.sqrt(float(np.mean(bake.points.error[own[near]] ** 2))) if near.any() else 0.0
        luminance = float(e @ harness.LUMINANCE)
        reference_e = np.array(sample['E'])
        share = reference_e / reference_e[0] if reference_e[0] > 0 else np.zeros(3)
        got.append(e)
        want.append(reference_e)
        errors.append(np.hypot(sample['stderr_r'] * share, own_error * e / luminance if luminance > 0 else 0.0))
        where.append('%s %s' % (name, sample['uv1']))
    return np.array(got), np.array(want), np.array(errors), where


def agreeing(got, want, errors):
    return ((np.abs(got - want) <= 5 * errors) | (np.abs(got - want) <= 0.02 * want)).all(1)


def main():
    add = lambda p: (p.add_argument('--only', metavar='SCENE', action='append', help='these scenes'),
                     p.add_argument('--full', action='store_true', help='all texels and samples for every scene'))
    arguments, kiln = harness.start(__doc__, add)
    checks = harness.Checks()
    missing = [s for s in SETTINGS if harness.own_scene(s + '.glb') is None
               or harness.own_scene('reference', s + '.json') is None]
    if len(missing) == len(SETTINGS):
        harness.skip('no reference scene is here.')
    table = harness.Table(('scene', 24), ('points', 7), ('agree', 8), ('mean ratio', 11), ('median error', 13),
                          ('seconds', 8),
                          ('energy', 36))
    for scene, (n, multiple, direct, bounce, indirect, coarse) in SETTINGS.items():
        if scene in missing or (kiln.thin > 1 and coarse is None) or (arguments.only and scene not in arguments.only):
            continue
        if scene in LESS and not arguments.full:
            multiple, direct, bounce, indirect = LESS[scene]
        with open(harness.own_scene('reference', scene + '.json')) as f:
            reference = json.load(f)
        path = harness.own_scene(scene + '.glb')
        if scene in SMOOTH:
            path = glb.without_normals(path, os.path.join(kiln.scratch, scene + '-flat.glb'))
        size = n * (coarse if kiln.thin > 1 else multiple)
        # the samples lie at places of the file's own UV set, so that its layout must stay
        bake = kiln.bake(path, '--denoise', 'none', '--lightmap-size', size, '--shared-texels', 'keep',
                         '--samples-direct', kiln.samples(direct), '--samples-bounce', kiln.samples(bounce),
                         '--samples-indirect', kiln.samples(indirect), '--samples-probe', 0)
        if checks.baked(bake):
            got, want, errors, where = compare(reference, bake)
            good = agreeing(got, want, errors)
            ratio = got.sum() / want.sum()
            lit = want.max(1) > 0
            median = float(np.median(np.abs(got - want)[lit].max(1) / want[lit].max(1)))
            text = checks.energy(bake, scene)
            table.row(scene, len(good), '%.1f %%' % (100 * good.mean()), '%.4f' % ratio, '%.2e' % median,
                      '%.1f' % bake.process.seconds, text)
            worst = np.argsort(-np.where(good, 0, np.abs(got - want).max(1)), kind='stable')[:5]
            checks.that(good.mean() >= 0.95, '%s: %.1f %% of %d points agree; the worst:%s' % (
                scene, 100 * good.mean(), len(good), ''.join('\n        %s: got %s, reference %s, error %s' % (
                    where[i], got[i], want[i], errors[i]) for i in worst)), bake.process)
            allowed = 0.005 + (4 * math.sqrt(float((errors ** 2).sum())) / want.sum() if kiln.thin > 1 else 0.0)
            checks.that(abs(ratio - 1) <= allowed, '%s: the mean is %.4f times the reference' % (scene, ratio),
                        bake.process)
            checks.that(agreeing(got * 1.05, want, errors)[lit].mean() < 0.95 or abs(ratio * 1.05 - 1) > allowed,
                        '%s: lightmaps 5 %% brighter would pass too' % scene)
        bake.remove()
    if missing:
        print('not here: ' + ', '.join(missing))
    checks.end()


if __name__ == '__main__':
    main()
